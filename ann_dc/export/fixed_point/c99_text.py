"""The text of the C99 export around its tables."""

HEADER = """\
/* {title}: a network in integers of {bits} bits, without floating point.
   Written by ann_dc; wiring {wiring}, content {content}. */
#ifndef ANN_DC_NETWORK_H
#define ANN_DC_NETWORK_H

#include <stdint.h>

enum {{
    ANN_DC_BITS = {bits},         /* of a word */
    ANN_DC_GUARD = {guard},        /* fraction bits of a state beyond its word's */
    ANN_DC_PERIOD = {period},       /* steps between two looks at whether words still move */
    ANN_DC_STAGES = {stages},
    ANN_DC_INPUTS = {inputs},
    ANN_DC_CONTROLS = {controls},
    ANN_DC_NEURONS = {neurons},
    ANN_DC_WORDS = {words},
    ANN_DC_STEPS = {steps}         /* until it settles, as it was exported */
}};

/* Inputs: words with fraction bits as in README.md. */
{input_names}

/* Controls, stage by stage. */
{control_names}

typedef struct {{
    int32_t words[ANN_DC_WORDS];
    int32_t marks[ANN_DC_NEURONS];
    int64_t states[ANN_DC_NEURONS];
    uint32_t steps;
}} ann_dc_network;

/* The start, with the inputs that the network was exported with. */
void ann_dc_start(ann_dc_network *network);

/* A word of an input at a stage; 0 where there is no such place. What does not fit is cut off. */
int ann_dc_load(ann_dc_network *network, int input, int stage, int32_t word);

/* A word of an input at all stages. */
int ann_dc_load_all(ann_dc_network *network, int input, int32_t word);

/* One step; 1 where the network is settled after it. */
int ann_dc_step(ann_dc_network *network);

/* Steps until it is settled, at most so many; how many were taken. */
uint32_t ann_dc_settle(ann_dc_network *network, uint32_t limit);

/* The word of a control; 0 where there is none. */
int32_t ann_dc_control(const ann_dc_network *network, int control);

#endif
"""

SOURCE = """\
/* {title}: see ann_dc_network.h. */
#include "ann_dc_network.h"

enum {{ OPERATIONS = {operations} }};
enum {{ KIND, TARGET, FIRST, LAST, SHIFT, NEURON }};             /* of an operation */
enum {{ SUM, PRODUCT, FUNCTION, RECTIFY, DRIVE, UPDATE }};       /* kinds */
enum {{ LOWEST, HIGHEST, SPACING, ENTRY }};                      /* of a table */
enum {{ WORD, AT_START, LOW, HIGH, THRESHOLD }};                 /* of a neuron */

{operation_table}

/* Word, coefficient. */
{edge_table}

{table_table}

{entry_table}

{start_table}

{neuron_table}

{input_table}

{control_table}

static const int64_t TOP = ((int64_t)1 << (ANN_DC_BITS - 1)) - 1;

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

static int64_t looked_up(const int32_t *table, int64_t x)
{{
    int32_t shift = table[SPACING];
    int64_t place = clipped(x, table[LOWEST], table[HIGHEST]) - table[LOWEST];
    const int32_t *entry = entry_table + table[ENTRY] + (place >> shift);
    int64_t share = place - ((place >> shift) << shift);
    return entry[0] + rounded(((int64_t)entry[1] - entry[0]) * share, shift);
}}

static int64_t computed(const int32_t *words, const int32_t *operation)
{{
    const int32_t first = operation[FIRST], last = operation[LAST];
    int64_t total = 0;
    int32_t e;
    switch (operation[KIND]) {{
    case PRODUCT:
        return rounded((int64_t)words[first] * words[last], operation[SHIFT]);
    case FUNCTION:
        return looked_up(table_table[first], words[last]);
    case RECTIFY:
        return rounded(words[last] > 0 ? words[last] : 0, operation[SHIFT]);
    default:
        for (e = first; e < last; ++e)
            total += (int64_t)edge_table[e][1] * words[edge_table[e][0]];
        return rounded(total, operation[SHIFT]);
    }}
}}

static void operate(ann_dc_network *network, const int32_t *operation)
{{
    int64_t value = computed(network->words, operation);
    int32_t target = operation[TARGET];
    if (operation[KIND] == UPDATE) {{
        const int64_t *neuron = neuron_table[operation[NEURON]];
        int64_t *state = network->states + operation[NEURON];
        *state = clipped(*state + value, neuron[LOW], neuron[HIGH]);
        value = rounded(*state, ANN_DC_GUARD);
        target = (int32_t)neuron[WORD];
    }}
    value = clipped(value, -TOP - 1, TOP);
    if (operation[KIND] == DRIVE) {{
        const int64_t *neuron = neuron_table[operation[NEURON]];
        int64_t state = network->states[operation[NEURON]];
        if ((state <= neuron[LOW] && value < 0) || (state >= neuron[HIGH] && value > 0))
            value = 0;
    }}
    network->words[target] = (int32_t)value;
}}

static int settled(ann_dc_network *network)
{{
    int n, still = 1;
    for (n = 0; n < ANN_DC_NEURONS; ++n) {{
        int32_t word = network->words[neuron_table[n][WORD]];
        int64_t moved = (int64_t)word - network->marks[n];
        if (moved > neuron_table[n][THRESHOLD] || -moved > neuron_table[n][THRESHOLD])
            still = 0;
        network->marks[n] = word;
    }}
    return still;
}}

void ann_dc_start(ann_dc_network *network)
{{
    int n;
    for (n = 0; n < ANN_DC_WORDS; ++n)
        network->words[n] = start_table[n];
    for (n = 0; n < ANN_DC_NEURONS; ++n) {{
        network->states[n] = neuron_table[n][AT_START];
        network->marks[n] = network->words[neuron_table[n][WORD]];
    }}
    network->steps = 0;
}}

int ann_dc_load(ann_dc_network *network, int input, int stage, int32_t word)
{{
    if (input < 0 || input >= ANN_DC_INPUTS || stage < 0 || stage >= ANN_DC_STAGES)
        return 0;
    network->words[input_table[input][stage]] = (int32_t)clipped(word, -TOP - 1, TOP);
    return 1;
}}

int ann_dc_load_all(ann_dc_network *network, int input, int32_t word)
{{
    int stage, loaded = 1;
    for (stage = 0; stage < ANN_DC_STAGES; ++stage)
        loaded &= ann_dc_load(network, input, stage, word);
    return loaded;
}}

int ann_dc_step(ann_dc_network *network)
{{
    int k;
    for (k = 0; k < OPERATIONS; ++k)
        operate(network, operation_table[k]);
    network->steps += 1;
    return network->steps % ANN_DC_PERIOD == 0 && settled(network);
}}

uint32_t ann_dc_settle(ann_dc_network *network, uint32_t limit)
{{
    uint32_t steps = 0;
    while (steps < limit) {{
        steps += 1;
        if (ann_dc_step(network))
            break;
    }}
    return steps;
}}

int32_t ann_dc_control(const ann_dc_network *network, int control)
{{
    if (control < 0 || control >= ANN_DC_CONTROLS)
        return 0;
    return network->words[control_table[control]];
}}
"""

SELFTEST = """\
/* Walks from the start, and compares the states with those of the golden model. */
#include "ann_dc_network.h"

#include <stdio.h>

enum {{ VECTORS = {vectors} }};

{counts}

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
            differ += network.states[n] != expected[v][n];
    }}
    ann_dc_start(&network);
    taken = ann_dc_settle(&network, 2 * counts[VECTORS - 1]);
    differ += taken != counts[VECTORS - 1];
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

FORMATS = """\
Words are signed integers of {bits} bits. A word w with f fraction bits stands for the user's value
offset + factor * w / 2^f.

| input | name | f | factor | offset |
|---|---|---|---|---|
{input_rows}

| control | name | f | factor | offset |
|---|---|---|---|---|
{control_rows}

A sum multiplies words by integer coefficients, adds exactly and is rounded once, to the nearest
integer with halves upward; so is a product, and a line between two entries of a table. What does
not fit into a word becomes the nearest that does. States have {guard} more fraction bits. After
every {period} steps the network is settled where no word of a neuron is further from where it was
{period} steps before than its threshold.

Settled after {steps} steps, the controls are within {error} of the largest control of the same
network in float64 (`reference_vector.json`). `fixed_point.json` has all integers.

Wiring {wiring}, content {content}.
"""

README = (
    """\
# {title}: C99 without floating point

`make check` compiles `selftest.c` and compares with the golden model, bit for bit.

    ann_dc_network network;
    ann_dc_start(&network);
    ann_dc_load_all(&network, 0, word);      /* other inputs: see below */
    ann_dc_settle(&network, 4 * ANN_DC_STEPS);
    word = ann_dc_control(&network, 0);

"""
    + FORMATS
)
