"""Text of the README of the C99 and SystemVerilog exports."""

FORMATS = """\
## Inputs that the words are for

Word ranges were chosen for {worth}. {own} An answer is right if its
controls are within {wrong:g} of the largest control of the same network in float64, or of {least:g}
times the largest for any of these inputs. If float64 does not settle, it walks again with half the
step for twice as long: from the start, then from the answer. The answer is unconfirmed if neither
settles; an export has no wrong or unconfirmed answer among those counted.

## Numbers

A number w with f fraction bits, an integer of {bits} bits, stands for the user's value
offset + factor * w / 2^f.

| input | name | f | factor | offset |
|---|---|---|---|---|
{input_rows}

| control | name | f | factor | offset |
|---|---|---|---|---|
{control_rows}

An input holds values from its lowest to its highest:

| input | name | lowest | highest |
|---|---|---|---|
{held_rows}

{beyond}

Words have {guard} more fraction bits, {wide} bits in all. A coefficient of a sum is an integer of
{bits} bits times a power of two. A sum reads whole words, adds exactly and is rounded once, to the
nearest integer with halves upward; so is a product, and a line between two entries of a table. What
is multiplied by another word, or looks up a table, is rounded to {bits} bits before.

## Status

- saturated: a result did not fit into its word, or an argument into its table, since the start. It
  became the nearest that does, and no answer follows: these inputs are outside the ranges. (A drive
  that points beyond a rail of its neuron is zero, and does not saturate.)
- settled: not saturated, and after a multiple of {period} steps no word of a neuron is further from
  where it was {period} steps before than its threshold, and no drive (net input of a neuron, the
  residual) is larger than another threshold.
- running: neither yet. A new input brings this status back, unless saturated.
- limit: neither, within as many steps as were allowed; {limit} are four times those of the
  slowest input that was tried.

Settled after {steps} steps, the controls are within {error} of the largest control of the same
network in float64 (`reference_vector.json`). `fixed_point.json` has all integers.

Wiring {wiring}, content {content}.
"""

BEYOND_C99 = """\
`ann_dc_load` takes numbers of 64 bits: one beyond these values is cut off and saturates. Do not
clamp it, or cast it to 32 bits, before: the network would settle for another value."""
BEYOND_HDL = """\
`data` has {bits} bits: do not load a value beyond these. A number that is clamped, or whose upper
bits are dropped, settles for another value, and no status shows it."""

C99 = (
    """\
# {title}: C99 without floating point

`make check` compiles `selftest.c` and compares with the golden model, bit for bit.

    ann_dc_network network;
    ann_dc_start(&network);
    ann_dc_load_all(&network, 0, number);      /* other inputs: see below */
    ann_dc_settle(&network, ANN_DC_LIMIT);
    if (ann_dc_status(&network) == ANN_DC_SETTLED)
        number = ann_dc_control(&network, 0);

Two networks in one program take two prefixes: export with `prefix=`.

"""
    + FORMATS
)
