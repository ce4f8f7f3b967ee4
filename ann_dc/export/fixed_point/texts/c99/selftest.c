/* Walks from the start, and compares the words of the neurons with those of the golden model. */
#include "ann_dc_network.h"

#include <stdio.h>

enum { VECTORS = @vectors@ };

@counts@

@places@

@expected@

static ann_dc_network network;

int main(void)
{
    int v, n, differ = 0;
    uint32_t taken;
    for (v = 0; v < VECTORS; ++v) {
        ann_dc_start(&network);
        while (network.steps < counts[v])
            (void)ann_dc_step(&network);
        for (n = 0; n < ANN_DC_NEURONS; ++n)
            differ += network.words[places[n]] != expected[v][n];
    }
    ann_dc_start(&network);
    taken = ann_dc_settle(&network, 2 * counts[VECTORS - 1]);
    differ += taken != counts[VECTORS - 1] || ann_dc_status(&network) != ANN_DC_SETTLED;
    printf("%s: %d differences in %d vectors, settled after %lu steps\n",
           differ ? "FAIL" : "PASS", differ, (int)VECTORS, (unsigned long)taken);
    return differ != 0;
}
