"""Text templates of the C99 export, without its tables."""

HEADER = """\
/* {title}: a network in integers of {bits} bits, without floating point.
   Written by ann_dc; wiring {wiring}, content {content}.
   Word ranges were chosen for {covers}. */
#ifndef ANN_DC_NETWORK_H
#define ANN_DC_NETWORK_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

enum {{
    ANN_DC_BITS = {bits},         /* of an input and of a control */
    ANN_DC_GUARD = {guard},        /* fraction bits of a word beyond theirs */
    ANN_DC_PERIOD = {period},       /* steps between two looks at whether words still move */
    ANN_DC_STAGES = {stages},
    ANN_DC_INPUTS = {inputs},
    ANN_DC_CONTROLS = {controls},
    ANN_DC_NEURONS = {neurons},
    ANN_DC_WORDS = {words},
    ANN_DC_STEPS = {steps},        /* until it settles, as it was exported */
    ANN_DC_LIMIT = {limit}         /* steps after which a run that has not settled will not */
}};

/* Status. Controls are an answer in ANN_DC_SETTLED alone. */
enum {{
    ANN_DC_RUNNING = 0,
    ANN_DC_SETTLED = 1,      /* still, residual small, nothing cut off */
    ANN_DC_SATURATED = 2,    /* a number did not fit since the start: inputs out of range */
    ANN_DC_LIMITED = 3       /* ann_dc_settle took as many steps as it may */
}};

/* Inputs: numbers with fraction bits as in README.md, and the values that they hold. */
{input_names}

/* Controls, stage by stage. */
{control_names}

typedef struct {{
    int32_t words[ANN_DC_WORDS];
    int32_t marks[ANN_DC_NEURONS];
    uint32_t steps;
    int saturated;           /* stays set until ann_dc_start */
    int status;
}} ann_dc_network;

/* The start, with the inputs that the network was exported with. */
void ann_dc_start(ann_dc_network *network);

/* Write a number into an input at a stage; 0 if there is no such place. A number that does not fit
   into ANN_DC_BITS bits is cut off, and saturates: pass it as it is, without a cast to int32_t. The
   status becomes ANN_DC_RUNNING, unless saturated. */
int ann_dc_load(ann_dc_network *network, int input, int stage, int64_t number);

/* A number into an input at all stages. */
int ann_dc_load_all(ann_dc_network *network, int input, int64_t number);

/* One step; 1 if the network is settled after it. */
int ann_dc_step(ann_dc_network *network);

/* Steps until it is settled, at most so many; how many were taken. */
uint32_t ann_dc_settle(ann_dc_network *network, uint32_t limit);

/* ANN_DC_RUNNING, ANN_DC_SETTLED, ANN_DC_SATURATED or ANN_DC_LIMITED. */
int ann_dc_status(const ann_dc_network *network);

/* The number of a control; 0 if there is none. */
int32_t ann_dc_control(const ann_dc_network *network, int control);

#ifdef __cplusplus
}}
#endif

#endif
"""

SOURCE = """\
/* {title}: see ann_dc_network.h. */
#include "ann_dc_network.h"

enum {{ OPERATIONS = {operations} }};
enum {{ KIND, TARGET, FIRST, LAST, SHIFT, NEURON }};             /* of an operation */
enum {{ SUM, PRODUCT, FUNCTION, RECTIFY, DRIVE, UPDATE }};       /* kinds */
enum {{ LOWEST, HIGHEST, SPACING, ENTRY }};                      /* of a table */
enum {{ WORD, AT_START, LOW, HIGH, STILL, DRIVEN, SMALL }};      /* of a neuron */

{operation_table}

/* Word, coefficient, exponent of its power of two. */
{edge_table}

{table_table}

{entry_table}

{start_table}

{neuron_table}

{input_table}

{control_table}

static const int64_t TOP = ((int64_t)1 << (ANN_DC_BITS - 1)) - 1;
static const int64_t WIDE = ((int64_t)1 << (ANN_DC_BITS + ANN_DC_GUARD - 1)) - 1;

static int64_t clipped(int64_t value, int64_t low, int64_t high)
{{
    return value < low ? low : value > high ? high : value;
}}

/* The largest integer that is not above a / 2^shift; C leaves it open for negative a >> shift. */
static int64_t floored(int64_t a, int32_t shift)
{{
    int64_t one = (int64_t)1 << shift;
    return a >= 0 ? a >> shift : -((-a + one - 1) >> shift);
}}

/* a / 2^shift to the nearest, halves upward. */
static int64_t rounded(int64_t a, int32_t shift)
{{
    if (shift > 0)
        return floored(a + ((int64_t)1 << (shift - 1)), shift);
    return a * ((int64_t)1 << -shift);
}}

/* A word as it is multiplied by another, or looks up a table. */
static int64_t factor(int32_t word)
{{
    return rounded(word, ANN_DC_GUARD);
}}

static int64_t looked_up(ann_dc_network *network, const int32_t *table, int64_t x)
{{
    int32_t shift = table[SPACING];
    int64_t inside = clipped(x, table[LOWEST], table[HIGHEST]);
    int64_t place = inside - table[LOWEST];
    const int32_t *entry = entry_table + table[ENTRY] + (place >> shift);
    int64_t share = place - ((place >> shift) << shift);
    if (inside != x)
        network->saturated = 1;
    return entry[0] + rounded(((int64_t)entry[1] - entry[0]) * share, shift);
}}

static int64_t computed(ann_dc_network *network, const int32_t *operation)
{{
    const int32_t first = operation[FIRST], last = operation[LAST];
    const int32_t *words = network->words;
    int64_t total = 0;
    int32_t e;
    switch (operation[KIND]) {{
    case PRODUCT:
        return rounded(factor(words[first]) * factor(words[last]), operation[SHIFT]);
    case FUNCTION:
        return looked_up(network, table_table[first], factor(words[last]));
    case RECTIFY:
        return rounded(words[last] > 0 ? words[last] : 0, operation[SHIFT]);
    default:
        for (e = first; e < last; ++e)
            total += (int64_t)edge_table[e][1] * ((int64_t)1 << edge_table[e][2])
                * words[edge_table[e][0]];
        return rounded(total, operation[SHIFT]);
    }}
}}

static void operate(ann_dc_network *network, const int32_t *operation)
{{
    int64_t value = computed(network, operation), low = -WIDE - 1, high = WIDE, kept;
    int32_t target = operation[TARGET];
    if (operation[KIND] == UPDATE) {{
        const int32_t *neuron = neuron_table[operation[NEURON]];
        target = neuron[WORD];
        low = neuron[LOW];
        high = neuron[HIGH];
        value += network->words[target];
    }}
    if (operation[KIND] == DRIVE) {{
        const int32_t *neuron = neuron_table[operation[NEURON]];
        int32_t state = network->words[neuron[WORD]];
        if ((state <= neuron[LOW] && value < 0) || (state >= neuron[HIGH] && value > 0))
            value = 0;
    }}
    kept = clipped(value, low, high);
    if (kept != value && (kept == WIDE || kept == -WIDE - 1))
        network->saturated = 1;
    network->words[target] = (int32_t)kept;
}}

static int beyond(int64_t value, int32_t threshold)
{{
    return value > threshold || -value > threshold;
}}

static int settled(ann_dc_network *network)
{{
    int n, still = 1;
    for (n = 0; n < ANN_DC_NEURONS; ++n) {{
        const int32_t *neuron = neuron_table[n];
        int32_t word = network->words[neuron[WORD]];
        if (beyond((int64_t)word - network->marks[n], neuron[STILL])
            || beyond(network->words[neuron[DRIVEN]], neuron[SMALL]))
            still = 0;
        network->marks[n] = word;
    }}
    return still && !network->saturated;
}}

void ann_dc_start(ann_dc_network *network)
{{
    int n;
    for (n = 0; n < ANN_DC_WORDS; ++n)
        network->words[n] = start_table[n];
    for (n = 0; n < ANN_DC_NEURONS; ++n)
        network->marks[n] = neuron_table[n][AT_START];
    network->steps = 0;
    network->saturated = 0;
    network->status = ANN_DC_RUNNING;
}}

int ann_dc_load(ann_dc_network *network, int input, int stage, int64_t number)
{{
    int64_t fit = clipped(number, -TOP - 1, TOP);
    if (input < 0 || input >= ANN_DC_INPUTS || stage < 0 || stage >= ANN_DC_STAGES)
        return 0;
    if (fit != number)
        network->saturated = 1;
    network->status = network->saturated ? ANN_DC_SATURATED : ANN_DC_RUNNING;
    network->words[input_table[input][stage]] = (int32_t)(fit * ((int64_t)1 << ANN_DC_GUARD));
    return 1;
}}

int ann_dc_load_all(ann_dc_network *network, int input, int64_t number)
{{
    int stage, loaded = 1;
    for (stage = 0; stage < ANN_DC_STAGES; ++stage)
        loaded &= ann_dc_load(network, input, stage, number);
    return loaded;
}}

int ann_dc_step(ann_dc_network *network)
{{
    int k, rests;
    for (k = 0; k < OPERATIONS; ++k)
        operate(network, operation_table[k]);
    network->steps += 1;
    rests = network->steps % ANN_DC_PERIOD == 0 && settled(network);
    network->status = network->saturated ? ANN_DC_SATURATED
                    : rests ? ANN_DC_SETTLED : ANN_DC_RUNNING;
    return rests;
}}

uint32_t ann_dc_settle(ann_dc_network *network, uint32_t limit)
{{
    uint32_t steps = 0;
    while (steps < limit) {{
        steps += 1;
        if (ann_dc_step(network))
            return steps;
    }}
    if (!network->saturated)
        network->status = ANN_DC_LIMITED;
    return steps;
}}

int ann_dc_status(const ann_dc_network *network)
{{
    return network->status;
}}

int32_t ann_dc_control(const ann_dc_network *network, int control)
{{
    if (control < 0 || control >= ANN_DC_CONTROLS)
        return 0;
    return (int32_t)clipped(factor(network->words[control_table[control]]), -TOP - 1, TOP);
}}
"""

SELFTEST = """\
/* Walks from the start, and compares the words of the neurons with those of the golden model. */
#include "ann_dc_network.h"

#include <stdio.h>

enum {{ VECTORS = {vectors} }};

{counts}

{places}

{expected}

static ann_dc_network network;

int main(void)
{{
    int v, n, differ = 0;
    uint32_t taken;
    for (v = 0; v < VECTORS; ++v) {{
        ann_dc_start(&network);
        while (network.steps < counts[v])
            (void)ann_dc_step(&network);
        for (n = 0; n < ANN_DC_NEURONS; ++n)
            differ += network.words[places[n]] != expected[v][n];
    }}
    ann_dc_start(&network);
    taken = ann_dc_settle(&network, 2 * counts[VECTORS - 1]);
    differ += taken != counts[VECTORS - 1] || ann_dc_status(&network) != ANN_DC_SETTLED;
    printf("%s: %d differences in %d vectors, settled after %lu steps\\n",
           differ ? "FAIL" : "PASS", differ, (int)VECTORS, (unsigned long)taken);
    return differ != 0;
}}
"""

MAKEFILE = """\
CC = cc
CFLAGS = -std=c99 -O2 -Wall -Wextra -pedantic -Werror -Wconversion

check: selftest
	./selftest

selftest: selftest.c ann_dc_network.c ann_dc_network.h
	$(CC) $(CFLAGS) -o $@ selftest.c ann_dc_network.c

clean:
	rm -f selftest

.PHONY: check clean
"""
