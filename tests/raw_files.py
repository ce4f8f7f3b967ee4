"""Raw files as ngspice writes them, for tests that read or fake them."""

import numpy as np


def header(names, points, flags="real", kind="Binary:", plot="Transient Analysis"):
    lines = ["Title: test", "Date: today", f"Plotname: {plot}", f"Flags: {flags}"]
    lines += [f"No. Variables: {len(names)}", f"No. Points: {points:<8}", "Variables:"]
    lines += [f"\t{i}\t{name}\tvoltage" for i, name in enumerate(names)]
    return "\n".join([*lines, kind, ""]).encode()


def binary(names, values, flags=None, **words):
    flags = flags or ("complex" if np.iscomplexobj(values) else "real")
    return header(names, len(values), flags, **words) + values.tobytes()


def text(names, values):
    flags = "complex" if np.iscomplexobj(values) else "real"
    number = (lambda v: f"{v.real!r},{v.imag!r}") if flags == "complex" else repr
    rows = ["\n\t".join([f"{i}", *map(number, row)]) for i, row in enumerate(values.tolist())]
    return header(names, len(values), flags, kind="Values:") + "\n".join([*rows, ""]).encode()


def ramp(end=1.0, points=5):
    time = np.linspace(0.0, end, points)
    return binary(["time", "v(x)"], np.stack([time, time**2], axis=1))
