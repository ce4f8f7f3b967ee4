"""Findings of studies that no network ran: numbers with known laws, and hostile words."""

import json
from pathlib import Path

import numpy as np
import pandas

from ann_dc.report.statistics import Findings
from ann_dc.study.store import Store

HOSTILE = "</script><img src=x onerror=\"document.title='broken in'\">"
IDENTITY = {
    "title": "Settling of the car on drawn parts",
    "version": 1,
    "subject": {"plant": "car", "parameters": {"N": 20, "dt": 0.1}, "inputs": {"q_d": [4.0, 1.5]}},
    "design": {"kind": "Latin hypercube", "count": 2000},
    "vary": {
        "problem.N": [10, 30, 100, 300, 1000],
        "nonideal.mismatch": {"normal": [0.0, 0.01]},
        "input.q_d.x": {"low": 2.0, "high": 8.0},
        "gains.tau.u": {"low": 0.01, "high": 1.0, "scale": "log"},
        "backend": ["ode", "recurrent"],
        "coordinators": [True, False],
    },
    "fixed": {"tolerance": 1e-6, "level": "behavioural"},
    "metrics": {
        "settling_time": {"unit": "us", "definition": "Last time at which a control is off."},
        "predicted_settling_time": {"unit": "us", "definition": "The same from the slowest mode."},
        "overshoot": {"unit": "", "definition": "Largest excursion beyond the settled control."},
        "power": {"unit": "mW", "definition": "Of all parts, settled."},
    },
    "settings": {
        "problem.N": {"unit": "", "says": "Horizon: the number of stages."},
        "nonideal.mismatch": {"unit": "", "says": "Standard deviation of every weight, over it."},
        "input.q_d.x": {"unit": "m", "says": "Where the car is to be in the end."},
        "gains.tau.u": {"unit": "", "says": "Time constant of the controls."},
        "backend": {"unit": "", "says": "What runs the network."},
        "coordinators": {"unit": "", "says": "Whether the row has a pyramid."},
    },
    "spec": {"settling_time": 30.0, "overshoot": [None, 0.25]},
    "seed": 7,
    "curves": True,
}  # fmt: skip
EXPONENT = 1.5
"""Of the wall time in N, exactly but for 1 % of scatter."""


def frame(count, seed=0):
    """Rows of a study of so many points; settling_time falls with tau, wall_time ~ N^1.5."""
    draw = np.random.default_rng(seed)
    horizon = draw.choice([10, 30, 100, 300, 1000], count)
    tau, mismatch = 10 ** draw.uniform(-2, 0, count), draw.normal(0, 0.01, count)
    target, backend = draw.uniform(2, 8, count), draw.choice(["ode", "recurrent"], count)
    pyramid = draw.random(count) < 0.5
    settling = 40 * tau**0.6 * (1 + 20 * np.abs(mismatch)) * np.where(pyramid, 1, 1.6)
    settling *= draw.lognormal(0, 0.15, count)
    failed, wild = draw.random(count) < 0.004, draw.random(count) < 0.02
    good = ~(failed | wild)
    outcome = np.where(failed, "failed", np.where(wild, "diverged", "settled"))
    message = [
        "ValueError: no gains for this target" if f
        else f"diverged at network time {t:.3g}: neuron mu[3].phi reached 1e9" if w
        else f"settled after {t:.4g} unit time constants"
        for f, w, t in zip(failed, wild, settling)
    ]  # fmt: skip
    return pandas.DataFrame({
        "point": np.arange(count), "seed": draw.integers(0, 2**63, count),
        "problem.N": horizon, "nonideal.mismatch": mismatch, "input.q_d.x": target,
        "gains.tau.u": tau, "backend": backend, "coordinators": pyramid,
        "settling_time": np.where(good, settling, np.nan),
        "predicted_settling_time": np.where(failed, np.nan, settling * draw.normal(1, 0.04, count)),
        "overshoot": np.where(good, np.abs(draw.normal(0.1, 0.05, count)) * target / 4, np.nan),
        "power": np.where(failed, np.nan, 3 + 0.2 * horizon + draw.normal(0, 1, count)),
        "outcome": outcome, "message": message,
        "wall_time": 1e-4 * horizon**EXPONENT * draw.lognormal(0, 0.01, count),
        "worker": draw.choice(["worker-1", "worker-2"], count), "host": "bench",
        "versions": json.dumps({"ann_dc": "0.1.0", "numpy": "2.4.6", "python": "3.13"}),
    })  # fmt: skip


def curve(point):
    """What a point did over time: its residual falls, the faster the smaller its number."""
    time = np.linspace(0, 50, 600)
    fall = np.exp(-time / (3 + point % 7))
    return {
        "time": time[::3], "u.a": np.ones((200, 20)), "energy": np.exp(-time[::3] / 4),
        "residual_time": time, "residuals": np.stack([fall, fall / 2], 1),
    }  # fmt: skip


class InMemory(Store):
    """Store of a study without a database."""

    def __init__(self, count, identity):
        self.folder, self.identity, self.count = Path("out/car study"), identity, count

    def to_frame(self):
        return frame(self.count)

    def curves(self, point):
        return curve(point) if point % 3 == 0 else {}


def store(count, **changed):
    return InMemory(count, IDENTITY | changed)


def findings(count, **changed):
    return Findings.of(store(count, **changed))


def hostile(count=60):
    """The same with words in every place that are meant to break out of the page."""
    table = frame(count).rename(columns={"gains.tau.u": HOSTILE, "overshoot": f"o{HOSTILE}"})
    table["message"] = HOSTILE
    table["backend"] = [HOSTILE, "ode"] * (count // 2)
    table["outcome"] = f"settled {HOSTILE}"
    table["versions"] = json.dumps({HOSTILE: HOSTILE})
    words = {"unit": HOSTILE, "says": HOSTILE, "definition": HOSTILE}
    identity = IDENTITY | {
        "title": HOSTILE, "subject": {HOSTILE: [HOSTILE]}, "design": HOSTILE,
        "vary": {HOSTILE: HOSTILE, "backend": HOSTILE}, "fixed": {HOSTILE: HOSTILE},
        "metrics": {"settling_time": words, f"o{HOSTILE}": words},
        "settings": {HOSTILE: words, "backend": words}, "spec": {f"o{HOSTILE}": 0.2},
        "seed": HOSTILE, "version": HOSTILE,
    }  # fmt: skip
    curves = {1: {"time": np.arange(3.0), HOSTILE: np.ones(3)}}
    return Findings(place=HOSTILE, identity=identity, frame=table, curves=curves)
