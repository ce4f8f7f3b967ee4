"""One network, one sample, several realisations."""

import numpy as np
import pytest

from ann_dc.study.library.circuits import REALISATIONS, realisations


@pytest.mark.slow
def test_emulated_op_amps_settle_later_than_the_ode_and_less_exactly():
    chosen = {name: REALISATIONS[name] for name in ("ODE", "recurrent", "op amps, emulated")}
    studies = realisations("double_integrator", {"q_d.x": (0.5, 1.5)}, chosen=chosen, samples=2)
    tables = {name: study.run(workers=0) for name, study in studies.items()}
    inputs = [table["input.q_d.x"] for table in tables.values()]
    assert (inputs[0] == inputs[1]).all()
    assert (inputs[0] == inputs[2]).all()
    times = {name: table["control_settling_time"] for name, table in tables.items()}
    assert all(np.isfinite(time).all() for time in times.values())
    assert (times["op amps, emulated"] > times["ODE"]).all()
    errors = {name: table["control_error"].max() for name, table in tables.items()}
    assert errors["ODE"] < 1e-6 < errors["op amps, emulated"] < 1e-2
