"""Saved solutions: what comes back is what was saved, and runs again with the same bits."""

from dataclasses import replace

import numpy as np
import pytest
from network_files import assert_same

import ann_dc
from ann_dc import plants
from ann_dc.errors import FileFormatError, OutputError
from ann_dc.problem.serialisation import written
from ann_dc.solution.saved_result import save_result

BACKEND = ann_dc.OdeBackend(verify=False)


def by_hand(problem):
    gains = ann_dc.manual_gains(ann_dc.synthesize(problem), rho=1.0, tau=0.5)
    return ann_dc.solve(problem, gains=gains, backend=BACKEND)


def cut_short(problem):
    return ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False, most_steps=3))


SOLVED = {
    "designed": lambda: ann_dc.solve(plants.double_integrator(N=4), backend=BACKEND),
    "with a free end": lambda: ann_dc.solve(
        plants.unicycle(N=5, q_d=(0.5, 0.2, None)), backend=BACKEND
    ),
    "gains by hand": lambda: by_hand(plants.double_integrator(N=3)),
    "another form": lambda: ann_dc.solve(
        plants.double_integrator(N=4), form=ann_dc.switch("S14"), backend=BACKEND
    ),
    "a tree": lambda: ann_dc.solve(
        plants.double_integrator(N=4),
        preconditioner=ann_dc.PreconditionerKind.CYCLIC_REDUCTION,
        backend=BACKEND,
    ),
    "a pyramid": lambda: ann_dc.solve(
        plants.double_integrator(N=4),
        preconditioner=ann_dc.PreconditionerKind.MULTILEVEL,
        backend=BACKEND,
    ),
    "not settled": lambda: cut_short(plants.pendulum(N=6)),
    "recurrent": lambda: ann_dc.solve(
        plants.double_integrator(N=3), backend=ann_dc.RecurrentBackend()
    ),
    "odd numbers": lambda: by_hand(
        plants.double_integrator(N=3).with_inputs(q_d=(-1e-7, 1 / 3)).with_horizon(2)
    ),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SOLVED)
def test_what_comes_back_is_what_was_saved(name, tmp_path):
    solution = SOLVED[name]()
    solution.save(tmp_path / "saved")
    again = ann_dc.load_solution(tmp_path / "saved")
    assert_same(again, solution, "solution")
    assert str(again) == str(solution)
    assert str(again.design) == str(solution.design)
    assert again.as_dict() == solution.as_dict() or name == "not settled"


def test_a_loaded_network_runs_with_the_same_bits(tmp_path):
    solution = SOLVED["with a free end"]()
    solution.save(tmp_path / "saved")
    again = ann_dc.load_solution(tmp_path / "saved")
    run = BACKEND.run(again.network)
    for field in ("time", "states", "residual_time", "residuals"):
        np.testing.assert_array_equal(
            getattr(run.trajectory, field), getattr(solution.trajectory, field)
        )
    assert run.settling_time == solution.settling_time
    solved = ann_dc.solve(again.problem, gains=again.design.gains, backend=BACKEND)
    np.testing.assert_array_equal(solved.trajectory.states, solution.trajectory.states)


def test_the_same_solution_gives_the_same_bytes(tmp_path):
    solution = SOLVED["gains by hand"]()
    for name in ("one", "two"):
        solution.save(tmp_path / name)
    files = sorted(file.name for file in (tmp_path / "one").iterdir())
    assert files == ["SHA256SUMS", "arrays.npz", "manifest.json", "network.npz"]
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_the_network_of_a_saved_solution_is_a_weight_file(tmp_path):
    solution = SOLVED["designed"]()
    solution.save(tmp_path / "saved")
    assert_same(ann_dc.load(tmp_path / "saved" / "network.npz"), solution.network)
    assert_same(ann_dc.load(tmp_path / "saved" / "design.npz"), solution.design.network)


def test_a_folder_that_exists_is_refused_and_stays(tmp_path):
    (tmp_path / "kept").mkdir()
    with pytest.raises(OutputError, match=r"exists already.*use a new folder"):
        SOLVED["gains by hand"]().save(tmp_path / "kept")
    assert list((tmp_path / "kept").iterdir()) == []


PARTS = SOLVED["gains by hand"]


@pytest.mark.parametrize("other", [plants.double_integrator(N=4), plants.unicycle(N=3)])
def test_a_network_of_another_problem_is_refused(other, tmp_path):
    solution = PARTS()
    records = {
        "problem": written(other),
        "form": solution.equations.form,
        "run": solution.run,
        "certificate": solution.certificate,
    }
    save_result(tmp_path / "mixed", {"network": solution.network}, records)
    with pytest.raises(FileFormatError, match=r"mixed.*which does not belong to the problem"):
        ann_dc.load_solution(tmp_path / "mixed")


@pytest.mark.parametrize("missing", ["problem", "form", "run", "certificate"])
def test_a_solution_without_a_part_is_refused(missing, tmp_path):
    solution = PARTS()
    records = {
        "problem": written(solution.problem),
        "form": solution.equations.form,
        "run": solution.run,
        "certificate": solution.certificate,
    }
    del records[missing]
    save_result(tmp_path / "part", {"network": solution.network}, records)
    with pytest.raises(FileFormatError, match=f"part: manifest.records: '{missing}' is missing"):
        ann_dc.load_solution(tmp_path / "part")


def test_a_design_without_its_network_is_refused(tmp_path):
    solution = SOLVED["designed"]()
    records = {
        "problem": written(solution.problem),
        "form": solution.equations.form,
        "run": solution.run,
        "certificate": solution.certificate,
        "design": solution.design,
    }
    save_result(tmp_path / "part", {"network": solution.network}, records)
    with pytest.raises(FileFormatError, match="unknown design"):
        ann_dc.load_solution(tmp_path / "part")


def test_save_overwrite_replaces_a_saved_solution_only(tmp_path):
    solution = SOLVED["gains by hand"]()
    solution.save(tmp_path / "saved")
    with pytest.raises(OutputError, match="use overwrite=True or --overwrite"):
        solution.save(tmp_path / "saved")
    (tmp_path / "saved" / "SHA256SUMS").unlink()
    solution.save(tmp_path / "saved", overwrite=True)
    assert ann_dc.load_solution(tmp_path / "saved").verdict == solution.verdict
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "manifest.json").write_text('{"format": "another"}')
    (tmp_path / "file").write_text("kept")
    for name in ("other", "file"):
        with pytest.raises(OutputError, match="it is not a saved solution"):
            solution.save(tmp_path / name, overwrite=True)
    assert (tmp_path / "file").read_text() == "kept"
    assert [file.name for file in (tmp_path / "other").iterdir()] == ["manifest.json"]


@pytest.mark.parametrize("name", ["stopped", "infeasible"])
def test_solution_whose_design_ended_early_is_saved(name, tmp_path):
    problem = ann_dc.plants.double_integrator(N=5)
    if name == "stopped":
        solution = ann_dc.solve(problem, time_limit=1e-3)
    else:
        solution = ann_dc.solve(replace(problem, bounds={problem.controls[0]: (-0.5, 0.5)}))
    assert solution.status.outcome.name == name.upper()
    solution.save(tmp_path / "result")
    again = ann_dc.load_solution(tmp_path / "result")
    assert str(again.status) == str(solution.status)
    assert str(again.design.first.ended) == str(solution.design.first.ended)
    assert again.design.first.ended is not None
    again.save(tmp_path / "again")
    for file in ("manifest.json", "arrays.npz"):
        assert (tmp_path / "again" / file).read_bytes() == (tmp_path / "result" / file).read_bytes()
