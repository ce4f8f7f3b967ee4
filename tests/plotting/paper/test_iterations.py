"""Figure 6 from plain numbers, and the figures of (21) and of Theorem IV.1."""

import numpy as np

from ann_dc.plotting.paper.iterations import Curves, definitions, following, gain_over_iterations

J = np.arange(1.0, 7.0)
CURVES = Curves(name="T_0", gain=0.5 / J, A=J, B=np.where(J < 4, -J, J), theta=10 * J)


def test_B_says_its_sign():
    axes = gain_over_iterations({"(a)": [CURVES], "(b)": [CURVES]}).axes
    assert len(axes) == 8
    by_marker = {line.get_marker(): line for line in axes[4].lines if len(line.get_xdata()) == 3}
    np.testing.assert_array_equal(by_marker["."].get_xydata(), np.stack([J[:3], J[:3]]).T)
    np.testing.assert_array_equal(by_marker["+"].get_xydata(), np.stack([J[3:], J[3:]]).T)


def test_a_column_a_case_with_the_third_iteration():
    axes = gain_over_iterations({"(a)": [CURVES], "(b)": [CURVES]}).axes
    assert [one.get_title(loc="left") for one in axes[:2]] == ["(a)", "(b)"]
    for one in axes:
        marked = [line for line in one.lines if line.get_label() == "third iteration"]
        assert [line.get_xdata()[0] for line in marked] == [3]
        assert one.get_yscale() == "log"
    assert [one.get_ylabel()[0] for one in axes[::2]] == ["λ", "A", "|", "Θ"]
    assert all(one.get_xlabel() == "outer iteration j" for one in axes[6:])


def test_what_is_foretold_stands_beside_what_theta_did():
    change = definitions([CURVES]).axes[3]
    foretold, did, _ = change.lines
    np.testing.assert_allclose(
        foretold.get_ydata(), CURVES.A * CURVES.gain**2 + CURVES.B * CURVES.gain
    )
    np.testing.assert_allclose(did.get_ydata(), 10.0)
    assert did.get_label() == "measured ΔΘ"


def test_quotients_stand_beside_their_rates():
    errors, quotients = following(J, {"e_v": (2 * J, 3.0), "e_mu": (J / 2, 1.0)}).axes
    np.testing.assert_allclose(quotients.lines[0].get_ydata(), 2.0)
    np.testing.assert_allclose(quotients.lines[1].get_ydata(), 3.0)
    labels = [line.get_label() for line in errors.lines]
    assert labels == ["|e_t, e_beta|", "|e_v|", "bound of |e_v|", "|e_mu|", "bound of |e_mu|"]
    np.testing.assert_allclose(errors.lines[2].get_ydata(), 3 * J)
