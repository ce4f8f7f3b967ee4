"""Noise in a netlist: sampled sources at virtual grounds and multipliers.

A transient analysis of ngspice has no noise that a seed would reproduce, so the samples of
`ann_dc.hardware.emulation.noise_currents` are written out. ngspice searches such a list from its
start at every time step: twice the samples take four times as long (a hundred sources of 1000
samples about 1 s).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import number, wrapped
from ann_dc.backends.spice.netlist.deck import Deck
from ann_dc.backends.spice.netlist.values import Nodes
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.noise_currents import Currents, Place
from ann_dc.validation import checked

MACRO = {"models/macro/mul4q.lib", "models/board/mul4q.lib"}
"""Models of multipliers that have a pole to which noise can be added."""

STEPS = 5
"""Smallest number of simulator steps between two samples: noise is too small for `reltol`."""


@checked
def with_noise(deck: Deck, circuit: Circuit, currents: Currents) -> Deck:
    """Return a deck with noise from the opening of its reset switches.

    The deck is of a level with single-ended op amps. The samples are in amperes, one step (in
    seconds) apart. The simulator takes at least `STEPS` steps between samples. Without noise the
    deck is unchanged. Raises `NetworkError` if the samples end before the run, or if noisy
    multipliers are not macro models.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.hardware.emulation import Currents
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> backend = ann_dc.SpiceBackend()
    >>> circuit, probe = backend.prepare(network)
    >>> deck = backend.deck(circuit, probe, {})
    >>> none = Currents(step=1e-6, sources=(), samples=np.zeros((0, 5, 1)))
    >>> with_noise(deck, circuit, none).text == deck.text
    True
    """
    if not currents.sources:
        return deck
    timing = deck.timing
    missing = timing.end - timing.release - currents.span
    if missing > 1e-9 * timing.end:
        raise NetworkError(
            f"noise: the samples end {missing:.3g} s before the run does; draw them for its "
            f"{timing.end - timing.release:.6g} s"
        )
    multipliers = any(source.place is Place.PRODUCT for source in currents.sources)
    if multipliers and MACRO.isdisjoint(deck.library):
        raise NetworkError(
            "noise: that of multipliers is known for macro models only; choose a macro level, or "
            "leave it out"
        )
    timing = replace(timing, step=min(timing.step, currents.step / STEPS))
    return replace(deck, noise=noise_cards(circuit, currents, timing.release), timing=timing)


def noise_cards(circuit: Circuit, currents: Currents, release: float) -> tuple[str, ...]:
    """Return the netlist lines of all noise sources.

    Samples are in amperes, and in volts for multipliers. The first sample flows at ``release``, in
    seconds.
    """
    times = release + currents.step * np.arange(currents.samples.shape[2])
    lines = ["* ---- noise"]
    for source, samples in zip(currents.sources, currents.samples):
        alias = circuit.alias[source.part]
        summing = Nodes(circuit).summing(source.part)
        for stage in np.flatnonzero(source.conductance):
            if source.place is Place.PRODUCT:
                lines += _voltage(alias, int(stage), times, samples[stage])
                continue
            name = f"I_{source.place.name.lower()}__{alias}__{stage}"
            start, end = _nodes(source.place, f"x_cell_{stage}", alias, summing)
            lines.append(source_card(name, start, end, times, samples[stage]))
    return tuple(lines)


def _voltage(alias: str, stage: int, times: np.ndarray, volts: np.ndarray) -> tuple[str, str]:
    """Return a voltage source and its addition to a macro multiplier's output.

    The voltage is added before the pole of the multiplier.
    """
    name, pole = f"product__{alias}__{stage}", f"x_cell_{stage}.x_{alias}.p"
    return (
        source_card(f"V_{name}", f"noise_{name}", "0", times, volts),
        f"G_{name} 0 {pole} noise_{name} 0 {{1m/mul_vsat}}",
    )


def _nodes(place: Place, cell: str, alias: str, summing: str) -> tuple[str, str]:
    """Return the nodes of a noise current inside a cell, as named by ngspice outside."""
    summing = summing.replace("@", f"{cell}.")
    return {
        Place.GROUND: ("0", summing),
        Place.FEEDBACK: (f"{cell}.x_{alias}.x", summing),
        Place.INVERTER: ("0", f"{cell}.xn_{alias}.s"),
    }[place]


def source_card(name: str, start: str, end: str, times: np.ndarray, samples: np.ndarray) -> str:
    """Return a source with linearly interpolated samples of volts or amperes.

    The times (K,) are in seconds. The samples (K,) are volts of ``start`` over ``end``, or amperes
    from ``start`` through the source to ``end``.

    Examples
    --------
    >>> source_card("I_1", "0", "s", np.array([0.0, 1e-6]), np.array([1e-12, -2e-12]))
    'I_1 0 s PWL( 0 1e-12 1e-06 -2e-12 )'
    """
    points = " ".join(f"{t:.12g} {number(i)}" for t, i in zip(times, samples))
    return wrapped(f"{name} {start} {end} PWL( {points} )")
