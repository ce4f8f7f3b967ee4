"""README of formats that do not write one: meaning and use of the files."""

from __future__ import annotations

from ann_dc.export.formats import Files, Format
from ann_dc.export.plain_reader import ARRAYS, reader
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.cell import Function
from ann_dc.network.network import Network
from ann_dc.network.selection import clamped_rows

README = "README.md"

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
file) has the equation and the formula of M under `about`, and under `tensors` what each array is,
with its axes and units. This program needs Python and NumPy alone; it takes the steps of the
reference vector, and prints how far each listed state is off.

""",
    "csv": """\
'weights.csv' has a row for everything that receives and a column for everything that sends, at all
stages: u[3].x is the control x of stage 3. 'tensors.csv' has every number of the network, a line
each, and 'manifest.json' says what its arrays are.
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
weight = (g_plus_S - g_minus_S) * divisor / scale, in siemens; 0 S is a place that is left open.
'conductances.json' has the scale of every column and the divisors. What is no weight, blocks and
preconditioner, is in 'network.npz'.

{_NAMES}""",
    "capacitors": f"""\
At a neuron x[k+1] = x[k] + sum(units / feedback_units * source), at a sum the same without x[k];
negative units take their source in the other phase. 'capacitors.json' has the step and the errors.

{_NAMES}""",
    "analog_computer": """\
Every element says a value between -1 and 1 machine unit, which stands for its `scale` times that.
A row of `matrix` is target, source, coefficient and the gain that multiplies it. Machine time is
the network's times `time_scale`.
""",
    "diagram": """\
Labels are the names that nodes have in all exports; numbers beside connections are weights.
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
    settles = f"settles after {vector.steps} steps" if vector.settles else "does not settle"
    return f"""# {" ".join(network.title.split())}: {form.title}

Files: {", ".join(f"`{file}`" for file in files)}.

It carries {form.carries}. It loses: {form.loses}.

{ABOUT[name]}{"".join(read)}
'reference_vector.json' has inputs, a start and the states that follow it in network units, by the
step {vector.step!r} in units of network time; the walk {settles} (tolerance {vector.tolerance!r}).
`ann-dc inspect` on this folder compares what the files do with it.
""".encode()


def without_readme(name: str, files: Files) -> Files:
    """Return the files to which a format's check applies."""
    return {file: content for file, content in files.items() if file != README or name not in ABOUT}
