"""Where the paper's Table 8 comes from: its misprinted equations, taken at their word, give its classes back.

The wrong equations live here only. They are Eqs. 2-6 in the paper's own matrix form, with numbers instead of symbols;
the package's derivation is used only in the last test, which shows that the right model has other classes.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dynid import load_robot
from dynid.model import build_model
from dynid.model.reduce import reduce
from dynid.robot import LINK_PARAMETERS

NAMES = [f"{name}{link}" for link in range(1, 8) for name in LINK_PARAMETERS]
#: Table 8 as coloured: G green, identifiable alone; R red, not identifiable; . empty, in combinations. Joints 1 to 7.
TABLE_8 = ["RR.GGGG"] * 4 + [
    "R......",
    "R..GGGG",
    "R..GGGG",
    ".......",
    "RGGG..G",
    "R.....G",
    "..GGGGG",
]
#: Empty cells that are no combination in the Gen2 column of Table 10; with them green the text counts rightly.
MISCOLOURED = ("mcy3", "mcz3", "Ixx3", "Ixy2", "Ixy3", "Ixz2", "Ixz3")
#: Eq. 9: which components of r are not zero, links 1 to 7, r12 = 0; any general values do.
EQ_9 = np.zeros((7, 3))
EQ_9[[0, 2, 3, 4, 4, 5, 6], [1, 0, 1, 1, 2, 2, 2]] = (0.28, 0.41, 0.21, 0.07, 0.15, 0.12, 0.16)
#: Table 6, but joints 5 and 6 with the 60 degrees of Eqs. 20-21.
TWISTS = np.radians([90, 90, 90, 90, 60, 60, 0])
Z = np.array([0.0, 0.0, 1.0])
PRINTED = {
    f"{name}{k + 1}": row[k]
    for name, row in zip(LINK_PARAMETERS, TABLE_8, strict=True)
    for k in range(7)
}
CORRECTED = PRINTED | dict.fromkeys(MISCOLOURED, "G")


def turn(theta, twist):
    """Return R_z(theta) R_x(twist) for each sample, (N, 3, 3)."""
    return (Rotation.from_euler("z", theta[:, None]) * Rotation.from_euler("x", twist)).as_matrix()


def times(R, v):
    return np.einsum("nij,nj->ni", R, v)


def printed_regressor(q, qd, qdd, *, gravity=0.0, twists=TWISTS, eq3_as_printed=True):
    """Return P of Eqs. 2-6 with Eq. 3 as printed: angular acceleration of link i-1, bracket turned, (N, 7, 77)."""
    R = [turn(q[:, i], twists[i]) for i in range(7)]
    w, dw, dv = np.zeros((3, len(q), 3))
    dv[:, 2] = gravity
    P = np.zeros((len(q), 7, 77))
    for k in range(7):
        back, r = R[k].transpose(0, 2, 1), EQ_9[k]
        before = dw
        dw = times(back, dw + qdd[:, [k]] * Z + qd[:, [k]] * np.cross(w, Z))
        w = times(back, w + qd[:, [k]] * Z)
        if eq3_as_printed:
            dv = times(back, dv + np.cross(before, r) + np.cross(w, np.cross(w, r)))
        else:
            dv = times(back, dv) + np.cross(dw, r) + np.cross(w, np.cross(w, r))
        for p, (f, moment) in enumerate(unit_wrenches(w, dw, dv)):
            for i in range(k, -1, -1):
                moment = times(R[i], moment + np.cross(EQ_9[i], f))
                f = times(R[i], f)
                P[:, i, 11 * k + p] = moment[:, 2]
        P[:, k, 11 * k + 10] = qdd[:, k]
    return P


def unit_wrenches(w, dw, dv):
    """Yield force and moment of one unit of m, mcx, ..., Izz (Eqs. 4-5)."""
    yield dv, np.zeros_like(dv)
    for e in np.eye(3):
        yield np.cross(dw, e) + np.cross(w, np.cross(w, e)), np.cross(e, dv)
    for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        unit = np.zeros((3, 3))
        unit[a, b] = unit[b, a] = 1.0
        yield np.zeros_like(dv), dw @ unit + np.cross(w, w @ unit)


def classify(P):
    """Return rank and the class of each of the 77 columns by singular values of the normalised, stacked regressor."""
    W = P.reshape(-1, 77)
    size = np.linalg.norm(W, axis=0)
    present = size > 1e-9
    values, Vt = np.linalg.svd(
        np.where(present, W / np.where(present, size, 1), 0), full_matrices=False
    )[1:]
    rank = int(np.sum(values > 1e-9 * values[0]))
    mixed = np.abs(Vt[rank:]).max(axis=0) > 1e-8
    cells = np.where(~present, "R", np.where(mixed, ".", "G"))
    return rank, dict(zip(NAMES, cells.tolist(), strict=True))


@pytest.fixture(scope="module")
def states():
    rng = np.random.default_rng(0)
    return rng.uniform(-3, 3, (60, 7)), *rng.normal(0, 2, (2, 60, 7))


def test_table_8_as_coloured_contradicts_the_counts_in_the_text_and_with_table_10_has_them():
    cells = [list(table.values()) for table in (PRINTED, CORRECTED)]
    assert [[each.count(c) for c in "GR."] for each in cells] == [[34, 13, 30], [41, 13, 14 + 9]]


def test_the_misprinted_equations_give_rank_55_and_76_of_77_cells(states):
    """Masses that stand alone come from the misprint of Eq. 3."""
    rank, cells = classify(printed_regressor(*states))
    assert rank == 55 == 41 + 14
    assert {name for name in NAMES if cells[name] != CORRECTED[name]} == {"Ixx3"}
    assert all(cells[f"m{k}"] == "G" for k in (4, 5, 6, 7))


def test_each_of_the_four_departures_is_needed(states):
    def matches(**change):
        cells = classify(printed_regressor(*states, **change))[1]
        return sum(cells[name] == CORRECTED[name] for name in NAMES)

    right_angles = np.radians([90, 90, 90, 90, 90, 90, 0])
    assert matches(gravity=9.81) < 76
    assert matches(twists=right_angles) == 74
    assert matches(eq3_as_printed=False, twists=right_angles) < 76


def test_the_right_model_matches_57_of_the_77_printed_cells():
    robot = load_robot(Path(__file__).parents[2] / "robots/paper/kinova_gen2_table6.yaml")
    right = reduce(build_model(robot))
    cells = dict.fromkeys(NAMES, ".") | dict.fromkeys(right.alone, "G")
    cells |= dict.fromkeys(right.none, "R")
    assert sum(cells[name] == PRINTED[name] for name in NAMES) == 57
    assert right.rank == 48
    assert not {"m4", "m5", "m6", "m7"} & set(right.alone)
