/* @title@: see ann_dc_network.h. */
#include "ann_dc_network.h"

enum { OPERATIONS = @operations@ };
enum { KIND, TARGET, FIRST, LAST, SHIFT, NEURON };             /* of an operation */
enum { SUM, PRODUCT, FUNCTION, RECTIFY, DRIVE, UPDATE };       /* kinds */
enum { LOWEST, HIGHEST, SPACING, ENTRY };                      /* of a table */
enum { WORD, AT_START, LOW, HIGH, STILL, DRIVEN, SMALL };      /* of a neuron */

@operation_table@

/* Word, coefficient, exponent of its power of two. */
@edge_table@

@table_table@

@entry_table@

@start_table@

@neuron_table@

@input_table@

@control_table@

static const int64_t TOP = ((int64_t)1 << (ANN_DC_BITS - 1)) - 1;
static const int64_t WIDE = ((int64_t)1 << (ANN_DC_BITS + ANN_DC_GUARD - 1)) - 1;

static int64_t clipped(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

/* The largest integer that is not above a / 2^shift; C leaves it open for negative a >> shift. */
static int64_t floored(int64_t a, int32_t shift)
{
    int64_t one = (int64_t)1 << shift;
    return a >= 0 ? a >> shift : -((-a + one - 1) >> shift);
}

/* a / 2^shift to the nearest, halves upward. */
static int64_t rounded(int64_t a, int32_t shift)
{
    if (shift > 0)
        return floored(a + ((int64_t)1 << (shift - 1)), shift);
    return a * ((int64_t)1 << -shift);
}

/* A word as it is multiplied by another, or looks up a table. */
static int64_t factor(int32_t word)
{
    return rounded(word, ANN_DC_GUARD);
}

static int64_t looked_up(ann_dc_network *network, const int32_t *table, int64_t x)
{
    int32_t shift = table[SPACING];
    int64_t inside = clipped(x, table[LOWEST], table[HIGHEST]);
    int64_t place = inside - table[LOWEST];
    const int32_t *entry = entry_table + table[ENTRY] + (place >> shift);
    int64_t share = place - ((place >> shift) << shift);
    if (inside != x)
        network->saturated = 1;
    return entry[0] + rounded(((int64_t)entry[1] - entry[0]) * share, shift);
}

static int64_t computed(ann_dc_network *network, const int32_t *operation)
{
    const int32_t first = operation[FIRST], last = operation[LAST];
    const int32_t *words = network->words;
    int64_t total = 0;
    int32_t e;
    switch (operation[KIND]) {
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
    }
}

static void operate(ann_dc_network *network, const int32_t *operation)
{
    int64_t value = computed(network, operation), low = -WIDE - 1, high = WIDE, kept;
    int32_t target = operation[TARGET];
    if (operation[KIND] == UPDATE) {
        const int32_t *neuron = neuron_table[operation[NEURON]];
        target = neuron[WORD];
        low = neuron[LOW];
        high = neuron[HIGH];
        value += network->words[target];
    }
    if (operation[KIND] == DRIVE) {
        const int32_t *neuron = neuron_table[operation[NEURON]];
        int32_t state = network->words[neuron[WORD]];
        if ((state <= neuron[LOW] && value < 0) || (state >= neuron[HIGH] && value > 0))
            value = 0;
    }
    kept = clipped(value, low, high);
    if (kept != value && (kept == WIDE || kept == -WIDE - 1))
        network->saturated = 1;
    network->words[target] = (int32_t)kept;
}

static int beyond(int64_t value, int32_t threshold)
{
    return value > threshold || -value > threshold;
}

static int settled(ann_dc_network *network)
{
    int n, still = 1;
    for (n = 0; n < ANN_DC_NEURONS; ++n) {
        const int32_t *neuron = neuron_table[n];
        int32_t word = network->words[neuron[WORD]];
        if (beyond((int64_t)word - network->marks[n], neuron[STILL])
            || beyond(network->words[neuron[DRIVEN]], neuron[SMALL]))
            still = 0;
        network->marks[n] = word;
    }
    return still && !network->saturated;
}

void ann_dc_start(ann_dc_network *network)
{
    int n;
    for (n = 0; n < ANN_DC_WORDS; ++n)
        network->words[n] = start_table[n];
    for (n = 0; n < ANN_DC_NEURONS; ++n)
        network->marks[n] = neuron_table[n][AT_START];
    network->steps = 0;
    network->saturated = 0;
    network->status = ANN_DC_RUNNING;
}

int ann_dc_load(ann_dc_network *network, int input, int stage, int64_t number)
{
    int64_t fit = clipped(number, -TOP - 1, TOP);
    if (input < 0 || input >= ANN_DC_INPUTS || stage < 0 || stage >= ANN_DC_STAGES)
        return 0;
    if (fit != number)
        network->saturated = 1;
    network->status = network->saturated ? ANN_DC_SATURATED : ANN_DC_RUNNING;
    network->words[input_table[input][stage]] = (int32_t)(fit * ((int64_t)1 << ANN_DC_GUARD));
    return 1;
}

int ann_dc_load_all(ann_dc_network *network, int input, int64_t number)
{
    int stage, loaded = 1;
    for (stage = 0; stage < ANN_DC_STAGES; ++stage)
        loaded &= ann_dc_load(network, input, stage, number);
    return loaded;
}

int ann_dc_step(ann_dc_network *network)
{
    int k, rests;
    for (k = 0; k < OPERATIONS; ++k)
        operate(network, operation_table[k]);
    network->steps += 1;
    rests = network->steps % ANN_DC_PERIOD == 0 && settled(network);
    network->status = network->saturated ? ANN_DC_SATURATED
                    : rests ? ANN_DC_SETTLED : ANN_DC_RUNNING;
    return rests;
}

uint32_t ann_dc_settle(ann_dc_network *network, uint32_t limit)
{
    uint32_t steps = 0;
    while (steps < limit) {
        steps += 1;
        if (ann_dc_step(network))
            return steps;
    }
    if (!network->saturated)
        network->status = ANN_DC_LIMITED;
    return steps;
}

int ann_dc_status(const ann_dc_network *network)
{
    return network->status;
}

int32_t ann_dc_control(const ann_dc_network *network, int control)
{
    if (control < 0 || control >= ANN_DC_CONTROLS)
        return 0;
    return (int32_t)clipped(factor(network->words[control_table[control]]), -TOP - 1, TOP);
}
