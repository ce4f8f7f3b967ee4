"""Networks in integers over an operating range: 10,000 inputs in C, at 16 and 32 bits.

Inputs are such as a word of 16 bits holds. An answer that the code calls settled is wrong if a
control is more than 1 % of the largest away from the controls at which the network settles in
float64, in continuous time and from the straight line of each input, as families are certified; or
if its controls alone, simulated, miss a fixed component of q_d by more than 1 cm (0.01 in the
problem's units) further than those of float64 do. Errors are those that the export measures itself
(`ann_dc.export.fixed_point.golden.control_errors`): if all controls of an input are below 5 % of
the largest for any input, they relate to that 5 %. An answer is unconfirmed, which counts as wrong,
if float64 does not settle, even in runs five times as long. No answer may be wrong, and at most 2
of 100 inputs may settle right in float64 alone. A pendulum has mirrored optima: the start decides
which one is met, so that its answers differ without being wrong.
"""

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from bench.families import FAMILIES as RANGES
from bench.figure import Figure, show

import ann_dc
from ann_dc.export.fixed_point import golden
from ann_dc.export.fixed_point.c99 import c99_files
from ann_dc.export.reference.vector import reference_vector

INPUTS, SEED = 10_000, 23
WIDTHS = (16, 32)
ACCURACY = 1e-3
"""Accuracy that exports are written for."""
MISSED = 0.01
"""Largest error of the simulated end."""
LONGER = 5
"""Limits of second runs in float64, over those of first ones."""
FAMILIES = {
    "unicycle": (lambda: ann_dc.plants.unicycle(N=10), {"q_d.x": (0.5, 2), "q_d.y": (-1.5, 1.5)}),
    "car": (ann_dc.plants.car, {"q_d.x": (3, 7), "q_d.y": (3, 7)}),
    "van_der_pol": (ann_dc.plants.van_der_pol, RANGES["van_der_pol"]),
    "two_link_arm": (ann_dc.plants.two_link_arm, RANGES["two_link_arm"]),
    "pendulum": (ann_dc.plants.pendulum, RANGES["pendulum"]),
    "double_integrator": (ann_dc.plants.double_integrator, {"q_d.x": (0.5, 2)}),
}
"""Problems and ranges; the first four are the bar."""
BULK = """
#include "ann_dc_network.h"
#include <stdio.h>
#include <stdlib.h>
static ann_dc_network network;
/* Lines of COUNT numbers, one an input of LOADED; status, steps and controls of each. */
int main(void) {
    static const int loaded[] = { LOADED };
    int i;
    long number;
    for (;;) {
        ann_dc_start(&network);
        for (i = 0; i < COUNT; ++i) {
            if (scanf("%ld", &number) != 1)
                return 0;
            ann_dc_load_all(&network, loaded[i], number);
        }
        (void)ann_dc_settle(&network, ANN_DC_LIMIT);
        printf("%d %lu", ann_dc_status(&network), (unsigned long)network.steps);
        for (i = 0; i < ANN_DC_CONTROLS; ++i)
            printf(" %ld", (long)ann_dc_control(&network, i));
        puts("");
    }
}
"""


def words_of(
    files: dict[str, bytes], values: dict[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], list[int], np.ndarray]:
    """Inputs as the words of an export hold them, the places of the inputs, and the numbers."""
    table = json.loads(files["fixed_point.json"])
    ports = {port["name"]: (index, port) for index, port in enumerate(table["inputs"])}
    numbers, places, held = [], [], {}
    for name, given in values.items():
        index, port = ports[name]
        last = 0.5 ** table["fraction"][port["words"][0]]
        numbers.append(np.rint((given - port["offset"]) / port["factor"] / last).astype(int))
        held[name] = port["offset"] + port["factor"] * numbers[-1] * last
        places.append(index)
    return held, places, np.transpose(numbers)


def in_c(files: dict[str, bytes], values: dict[str, np.ndarray]) -> np.ndarray:
    """(B, 2 + controls): status, steps and controls in the user's units, from compiled code."""
    table = json.loads(files["fixed_point.json"])
    _, places, numbers = words_of(files, values)
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            (Path(folder) / name).write_bytes(content)
        source = BULK.replace("LOADED };", ", ".join(map(str, places)) + " };")
        source = source.replace("COUNT;", f"{len(values)};")
        (Path(folder) / "bulk.c").write_text(source)
        command = ["cc", "-O3", "-o", "bulk", "bulk.c", "ann_dc_network.c"]
        subprocess.run(command, cwd=folder, check=True)
        text = "\n".join(" ".join(map(str, row)) for row in numbers)
        said = subprocess.run(
            [Path(folder) / "bulk"], input=text, capture_output=True, text=True, check=True
        ).stdout
    found = np.array([line.split() for line in said.splitlines()], float)
    for column, port in enumerate(table["controls"], start=2):
        fraction = table["fraction"][port["words"][0]]
        found[:, column] = port["offset"] + port["factor"] * found[:, column] / 2.0**fraction
    return found


def missed(
    problem: ann_dc.OptimalControlProblem, values: dict[str, np.ndarray], u: np.ndarray
) -> np.ndarray:
    """(B,): how far controls (B, m, N) alone end from the fixed components of q_d."""
    names = [str(state) for state in problem.states]
    ends = []
    for end, own in (("q_0", problem.q_0), ("q_d", problem.q_d)):
        rows = [np.full(len(u), np.nan if value is None else float(value)) for value in own or ()]
        for name, given in values.items():
            if name.startswith(f"{end}."):
                rows[names.index(name.partition(".")[2])] = given
        ends.append(np.array(rows))
    q, last = ends
    for k in range(u.shape[2]):
        q = problem.functions.map(q, u[:, :, k].T)
    return np.nan_to_num(np.abs(q - last), nan=0.0).max(0)


def in_floats(
    network: ann_dc.Network, values: dict[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States (B, n), and which settle (B,) bool: in first runs, and in first or longer ones."""
    backend = ann_dc.OdeBackend()
    first = backend.run_batch(network, values)
    states, confirmed = first.states.copy(), first.settled.copy()
    again = ~first.settled
    if again.any():
        limit, most_steps = LONGER * backend.limit, LONGER * backend.most_steps
        longer = ann_dc.OdeBackend(limit=limit, most_steps=most_steps).run_batch(
            network, {name: given[again] for name, given in values.items()}
        )
        states[again], confirmed[again] = longer.states, longer.settled
    return states, first.settled, confirmed


def of_family(
    name: str,
    problem: ann_dc.OptimalControlProblem,
    network: ann_dc.Network,
    count: int,
    seed: int = SEED,
) -> Iterator[Figure]:
    """Two a width."""
    rng = np.random.default_rng(seed)
    values = {key: rng.uniform(*ends, count) for key, ends in network.ranges.items()}
    vector, exported = reference_vector(network), {}
    for bits in WIDTHS:
        began = time.process_time()
        exported[bits] = (
            c99_files(network, vector, bits=bits, accuracy=ACCURACY),
            time.process_time() - began,
        )
    values, _, _ = words_of(exported[min(WIDTHS)][0], values)
    states, floats, confirmed = in_floats(network, values)
    rows = network.of_population("u")
    wanted = network.user_units(states)[:, rows]
    u_shape = (count, -1, network.stages)
    order = np.lexsort(network.places[rows].T[::-1])
    end = missed(problem, values, wanted[:, order].reshape(u_shape))
    for bits, (files, took) in exported.items():
        found = in_c(files, values)
        settled = found[:, 0] == 1
        off = golden.control_errors(found[:, 2:], wanted, confirmed)
        miss = missed(problem, values, found[:, 2:][:, order].reshape(u_shape)) - end
        both = settled & confirmed
        right = both & (off <= golden.WRONG * ACCURACY) & (miss <= MISSED)
        wrong, unconfirmed = int((both & ~right).sum()), int((settled & ~confirmed).sum())
        yield Figure(
            name=f"{name}, {bits} bits: wrong among settled",
            value=f"{wrong + unconfirmed} of {settled.sum()}",
            remark=f"seed {seed}; {unconfirmed} unconfirmed; largest error {off[both].max():.1e}, "
            f"simulated end {miss[both].max():.1e} further; written in {took:.1f} s of CPU time",
            good=wrong + unconfirmed == 0,
        )
        yield Figure(
            name=f"{name}, {bits} bits: settled right",
            value=f"{right.mean():.2%}",
            remark=f"float64 {floats.mean():.2%}; saturated {(found[:, 0] == 2).sum()}, "
            f"limit {(found[:, 0] == 3).sum()}; median {np.median(found[settled, 1]):.0f} steps",
            good=right.mean() >= floats.mean() - golden.MISSING,
        )


def figures(
    names: Sequence[str] = tuple(FAMILIES)[:4],
    count: int = INPUTS,
    networks: str = "",
    seed: int = SEED,
) -> Iterator[Figure]:
    """Four a family; networks are designed, or loaded from a folder."""
    for name in names:
        declared, ranges = FAMILIES[name]
        problem = declared()
        saved = Path(networks) / f"{name}.npz"
        network = ann_dc.load(saved) if networks else ann_dc.design(problem, ranges=ranges).network
        yield from of_family(name, problem, network, count, seed)


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(FAMILIES)[:4], help="four by default")
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--seed", type=int, default=SEED, help="of the inputs")
    parser.add_argument("--networks", default="", help="folder with NAME.npz; designed by default")
    options = parser.parse_args()
    return show(figures(options.names, options.inputs, options.networks, options.seed))


if __name__ == "__main__":
    raise SystemExit(main())
