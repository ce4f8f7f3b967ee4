"""A multiplier's subcircuit by itself in ngspice: sweeps, and the coefficients that they tell."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.hardware.parts.parasitics import MultiplierLaw

Sweep = tuple[np.ndarray, ...]
"""(x, y, z, out): both inputs over full scale, what is added and the output in volts."""


@dataclass(frozen=True)
class Bench:
    """Where a `mul4q` is swept."""

    models: Sequence[str]
    options: str
    timeout: float

    def ran(self, cards: Iterable[str], nodes: Sequence[str]) -> np.ndarray:
        """(nodes, 21) volts while v(a) goes from -1 V to 1 V."""
        saved = ".save " + "\n+ ".join(f"v({node})" for node in nodes)
        ends = [".dc Va -1 1 0.1", f".options {self.options}", saved, ".end\n"]
        deck = "\n".join(["* sweep", *self.models, "Va a 0 0", *cards, *ends])
        raw = Ngspice(timeout=self.timeout).run(deck)
        return np.array([np.real(raw[node]) for node in nodes])

    def grid(
        self,
        volts: float,
        ys: np.ndarray,
        zs: np.ndarray,
        *,
        gain: float = 1.0,
        reach: float | None = None,
    ) -> Sweep:
        """Sweep x as far as y; full scale, y, z and the reach of the output are in volts."""
        end = float(np.abs(ys).max())
        cards, nodes, at = [f"E1 x 0 a 0 {end}"], [], []
        for i, y in enumerate(ys):
            for j, z in enumerate(zs):
                node = f"{i}_{j}"
                cards += [f"Vy{node} y{node} 0 {y:.9g}", f"Vz{node} z{node} 0 {z:.9g}"]
                cards += [f"X{node} x 0 y{node} 0 z{node} o{node} mul4q vm={volts} ge={gain - 1}"]
                nodes.append(f"o{node}")
                at.append((y, z))
        out = self.ran(cards, nodes)
        x = np.linspace(-end, end, out.shape[1]) + 0 * out
        y, z = (np.array(at).T[k][:, None] + 0 * out for k in (0, 1))
        within = np.abs(out) <= (reach or 1.05 * volts)
        return tuple(part[within] for part in (x / volts, y / volts, z, out))

    def loaded(self) -> tuple[float, np.ndarray]:
        """What an input draws at zero, in A, and the output's resistance, in ohms."""
        cards = ["V1 one 0 1", "R1 a x 10k", "X1 x 0 one 0 0 o mul4q"]
        cards += ["X2 a 0 one 0 0 p mul4q", "X3 a 0 one 0 0 q mul4q", "R2 q 0 50k"]
        a, x, p, q = self.ran(cards, ["a", "x", "p", "q"])
        return np.interp(0.0, a, (a - x) / 10e3), ((p - q) / q * 50e3)[np.abs(p) > 0.5]


def reported(law: MultiplierLaw, volts: float, sweep: Sweep, gain: float = 1.0) -> np.ndarray:
    """The output that a law says."""
    x, y, z, out = sweep
    added, bend_x, bend_y, follow, tilt_x, tilt_y, bow, offset = known(law)
    slope = added + bend_x * x**2 + bend_y * y**2 + volts * (tilt_x * x + tilt_y * y)
    return gain * volts * x * y * (1 + slope) + (1 + follow) * z + offset + bow * (out**2 - z**2)


def known(law: MultiplierLaw) -> list[float]:
    """The coefficients of a law at a full scale."""
    gain = law.gain[0] + law.gain_y[0] + law.gain_o[0]
    bends = [gain, law.bend_x[0], law.bend_y[0], law.follow[0]]
    return [*bends, law.tilt_x, law.tilt_y, law.bow[0], law.offset[0]]


def found(volts: float, sweep: Sweep) -> np.ndarray:
    """The same coefficients, by least squares."""
    x, y, z, out = sweep
    t = volts * x * y
    terms = [t, t * x**2, t * y**2, z, t * x * volts, t * y * volts, out**2 - z**2, np.ones_like(t)]
    return np.linalg.lstsq(np.array(terms).T, out - t - z, rcond=None)[0]
