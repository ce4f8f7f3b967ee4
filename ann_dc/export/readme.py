"""README of formats that do not write one, with a program that reads weights with NumPy alone."""

from __future__ import annotations

from collections.abc import Iterable
from string import Template

from ann_dc.export.formats import Files, Format
from ann_dc.export.index import INDEX
from ann_dc.export.reference.contents import not_run
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.cell import Function
from ann_dc.network.functions import ELEMENTARY, NUMPY, function_block, written
from ann_dc.network.network import Network
from ann_dc.network.selection import clamped_rows

ARRAYS = {
    "network.safetensors": """\
raw = open(folder + "/network.safetensors", "rb").read()
body = 8 + int.from_bytes(raw[:8], "little")
a = {n: np.frombuffer(raw[body:][slice(*e["data_offsets"])], "<f8").reshape(e["shape"])
     for n, e in json.loads(raw[8:body]).items() if n != "__metadata__"}
""",
    "network.npz": """\
a = dict(np.load(folder + "/network.npz"))
""",
}
"""Statements that read the arrays, by file name."""

NETWORK = """\
N, left, names = m["stages"], m["left_boundary"], [n["name"] for n in m["neurons"]]
scales = a.get("input_scale", [(1, 0)] * len(m["inputs"]))
inputs = {i: (a["input/" + i] - zero) / unit for i, (unit, zero) in zip(m["inputs"], scales)}
shared = np.array(["shared" in n for n in m["neurons"]])
live = ~shared[:, None] | (np.arange(N) == N - 1)
for e in m["fixed"] + m["omitted"]: live[names.index(e["neuron"]), e["stage"]] = False
rates = live / np.array([a["tau/" + n] * np.ones(N) for n in names])
low, high = a["limits"].T[:, :, None]
wires, near = collections.defaultdict(list), {"previous": -1, "self": 0, "next": 1}
for c, n in zip(m["connections"], [n for n in m["tensors"] if n.startswith("weight/")]):
    k = np.clip(N + 1 + near.get(c["template"], c["template"]), 0, 2 * N + 1)
    wires[c["target"]].append((a[n], c["source"], k))
M, at = np.diag(rates.ravel()), np.arange(len(names) * N).reshape(-1, N)
for level in range(m["preconditioner"]["levels"]):  # M += H S H' over q_0, t_0, q_1, ...
    S, p = a[f"gain/{level}"], np.arange(2 * N)[:, None] / (2 * N - 1)
    H = np.maximum(0, 1 - abs(p * (len(S) - 1) - np.arange(len(S))))
    z = [at[[names.index(n) for n in chain]].T.ravel() for chain in m["chains"]]
    for i, j in np.ndindex(S.shape[1:]): M[np.ix_(z[i], z[j])] += H * S[:, i, j] @ H.T
if "stiffness/own" in a:  # M = T^(1/2) S^-1 T^(1/2) over the live primal neurons
    z = at[[n["role"] == "primal" for n in m["neurons"]]].T.ravel()
    S, k, used = np.zeros((N, len(z) // N) * 2), np.arange(N), live.ravel()[z]
    S[k[:-1], :, k[1:]] = a["stiffness/following"]
    S += S.transpose(2, 3, 0, 1)
    S[k, :, k] = a["stiffness/own"]
    z, S = z[used], np.linalg.inv(S.reshape(len(z), -1)[np.ix_(used, used)])
    M[np.ix_(z, z)] = S * np.sqrt(np.outer(rates.ravel()[z], rates.ravel()[z]))
def state(x):  # (P, N) with fixed and shared neurons filled in
    x = np.where(live, x, 0.0)
    for e in m["fixed"]: x[names.index(e["neuron"]), e["stage"]] = inputs[e["input"]][e["stage"]]
    return np.where(shared[:, None], x[:, -1:], x)
$rails
def moves(x):  # dx/ds (P, N)
    value = {"one": np.ones(3 * N + 1)}  # of every node: in the N cells, and beyond the two ends
    def node(n, v):
        value[n] = np.r_[[0.0] * N, inputs[left[n]][0] if n in left else 0, v, [0.0] * N]
    def arriving(n): return sum((w * value[s][k : k + N] for w, s, k in wires[n]), np.zeros(N))
    for n, v in [*inputs.items(), *zip(names, x)]: node(n, v)
    for b in m["blocks"]:
        f, read = b.get("function", b["kind"]), [value[b[e]][N + 1 : -N] for e in "abx" if e in b]
        own = {"product": np.multiply, "rectify": lambda x: np.maximum(x, 0), "sum": arriving,
               $functions}
        node(b["name"], (own.get(f) or getattr(np, f))(*read or [b["name"]]))  # as NumPy calls f
    d = np.array([arriving(n) for n in names])
    d[shared, -1] = d[shared].sum(1)
    return $moves
v = json.load(open(folder + "/reference_vector.json"))
expected = {int(k): x for k, x in v["early"].items()} | {v["steps"]: v["end"]}
x = state([a.get("start/" + n, np.zeros(N)) for n in names])
for k in range(1, max(expected) + 1):
    x = state(np.clip(x + v["step"] * moves(x), low, high))
    if k in expected: print(k, abs(x - expected[k]).max())
"""

CUT = {
    "rails": """\
def held(x, move):  # 0 where it would push a neuron beyond the limit at which it is
    return np.where((x <= low) & (move < 0) | (x >= high) & (move > 0), 0, move)""",
    "moves": "held(x, (M @ held(x, np.where(live, d, 0)).ravel()).reshape(x.shape) * live)",
}
"""Statements for networks whose neurons with saturation limits are not coupled by M."""

PROJECTED = {
    "rails": """\
def projected(x, d):  # v = M (d + r): currents r of diodes hold neurons at limits
    def outward(y): return (x <= low) & (y < 0) | (x >= high) & (y > 0)
    held = outward(d)
    for turn in range(1000):
        r, C = np.zeros(d.size), np.flatnonzero(held)
        r[C] = -np.linalg.solve(M[np.ix_(C, C)], M[C] @ d.ravel())
        v = np.where(held, 0, (M @ (d.ravel() + r)).reshape(x.shape))
        tiny = 1e-13 * (abs(d.ravel()) + abs(r))[C].max(initial=0)
        wrong = np.flatnonzero(outward(v + np.where(abs(r) > tiny, r, 0).reshape(x.shape)))
        if not len(wrong): break  # no v and no r points outward
        held.ravel()[wrong if turn < 10 else wrong[-1:]] ^= True
    return np.where(outward(v), 0, v)""",
    "moves": "projected(x, np.where(live, d, 0))",
}
"""Statements for networks with saturation limits at neurons that M couples."""


NAMED = ("rectify", "reciprocal")
"""Function blocks that `NETWORK` or NumPy has by name, in addition to elementary ones."""


def reader(file: str, *, is_clamped: bool = True, functions: Iterable[str] = ()) -> str:
    """Return a program that reads the weights in ``file`` and repeats the test vector.

    Set ``is_clamped`` if the preconditioner couples neurons that have saturation limits.
    ``functions`` are the names of the network's function blocks.
    """
    parts = PROJECTED if is_clamped else CUT
    return f"""\
import collections, json, sys
import numpy as np
folder = (sys.argv[1:] or ["."])[0]
m = json.load(open(folder + "/manifest.json", encoding="utf-8"))
{ARRAYS[file]}{Template(NETWORK).substitute(parts, functions=_functions(functions))}"""


def _functions(used: Iterable[str]) -> str:
    """Return the entries of functions that NumPy does not have under the name of their block."""
    entries = [f'"{name}": np.{other}' for other, name in ELEMENTARY.items() if other != name]
    lines = [", ".join(entries)]
    for block in map(function_block, used):
        if not block.is_elementary and block.name not in NAMED:
            formula = written(block.trees[0], {"x": "x"}, NUMPY)
            lines.append(f'"{block.name}": lambda x: {formula}')
    return ",\n               ".join(dict.fromkeys(lines))


_NAMES = """\
A connection is written target<-source: 'u.' are controls, 'q.' states, 't.', 'mu.' and 'beta.'
multipliers, 'sum.' with a number a sum without a name, 'one' the constant 1.
"""
_BOUGHT = """\
Values are those of the ideal network: neither resistances of many megohms nor capacitances of a few
femtofarads can be bought or built. `pack` with series=E96-pairs has a bill of parts that can be.
"""

ABOUT: dict[str, str] = {
    "weights": """\
`ann_dc.load` reads the weight file. Without ann_dc: 'manifest.json' (the same text is in the weight
file) has the equation and the formula of M under `about`, and under `tensors` the meaning of each
array, with its axes and units. This program needs Python and NumPy alone; it takes the steps of the
reference vector, and prints how far each listed state is off.

""",
    "csv": """\
'weights.csv' has a row for everything that receives and a column for everything that sends, at all
stages: u[3].x is the control x of stage 3. 'tensors.csv' has every number of the network, a line
each, and 'manifest.json' describes its arrays.
""",
    "onnx": """\
'step.onnx' takes states, inputs and step to next_states and the residual of the states given;
'settle.onnx' takes tolerance and limit (a whole number of steps) too, and gives settled_states,
residual and steps. An infinite residual: the sample diverged or left the domain of a function.
States are (neurons, stages, samples), inputs (inputs, stages, samples). The metadata `neurons` and
`inputs` names the rows in turn, with factor and offset: a user's value is offset + factor * the
network's. Controls are the neurons whose names begin with 'u.'. Start, step and tolerance that do
are in 'reference_vector.json'.
""",
    "torch_program": """\
`torch.export.load("torch_program.pt2").module()` takes x (B, n), inputs (B, I, N) and step (), and
gives a dict: `x` a step later, and `residual` (B,) before it. 'torch_program.json' names the
components of x, the inputs with factor and offset, and the rows of the tensors that it holds.
Controls are the components whose names begin with 'u['.
""",
    "nir": """\
`nir.read("network.nir")` gives the graph. The columns of `input_weights` are the values of the
first input at all stages, then those of the second, in the order of 'nir.json'; the components of
`output` are its `states`. Without inputs there is one column of zeros, since NIR asks for an input.
`synapses` is a Linear where there is no bias, else an Affine: check that your reader copies its
bias (nirtorch 2.6 does not). Time is the network's, that of the time constants and of the step of
'reference_vector.json', which has the start as well: NIR has none.
""",
    "conductances": f"""\
weight = (g_plus_S - g_minus_S) * divisor / scale, in siemens; 0 S is an open place.
'conductances.json' has the scale of every column and the divisors. Blocks and the
preconditioner are in 'network.npz'.

{_NAMES}""",
    "capacitors": f"""\
At a neuron x[k+1] = x[k] + sum(units / feedback_units * source), at a sum the same without x[k];
negative units take their source in the other phase. 'capacitors.json' has the step and the errors.

{_NAMES}""",
    "analog_computer": """\
Every element has a value between -1 and 1 machine unit, to be multiplied by its `scale`.
A row of `matrix` is target, source, coefficient and the gain that multiplies it. Machine time is
the network's times `time_scale`.
""",
    "diagram": """\
Labels are the names that nodes have in all exports; numbers at connections are weights.
""",
    "schematic": _BOUGHT,
    "latex": """\
'equations.tex' is a document by itself: `pdflatex equations.tex`.
""",
}
"""Format-specific text, by format name, for formats without their README."""


def readme(
    name: str, form: Format, network: Network, vector: ReferenceVector, files: Files
) -> bytes:
    """Return a README for readers that have only the folder."""
    is_clamped = len(clamped_rows(network)) > 0
    functions = [block.function for block in network.cell.blocks if isinstance(block, Function)]
    read = [
        f"```python\n{reader(file, is_clamped=is_clamped, functions=functions)}```\n"
        for file in ARRAYS
        if name == "weights" and file in files
    ]
    compared = "the results of the files"
    if form.executes or form.run is not_run:
        compared = f"the SHA-256 of the files with '{INDEX}'"
    settles = f"settles after {vector.steps} steps" if vector.settles else "does not settle"
    return f"""# {" ".join(network.title.split())}: {form.title}

Files: {", ".join(f"`{file}`" for file in files)}.

It carries {form.carries}. It loses: {form.loses}.

{ABOUT[name]}{"".join(read)}
'reference_vector.json' has inputs, a start and the states that follow it in network units, by the
step {vector.step!r} in units of network time; the walk {settles} (tolerance {vector.tolerance!r}).
`ann-dc inspect` on this folder compares {compared}.
""".encode()
