"""Physical possibility: the bodies of the full set as ellipsoids on the arm, and where their numbers come from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import link_frames
from dynid.model.parameters import second_moments
from dynid.reports.figures import ESTIMATED, MEASURED, RESIDUAL
from dynid.reports.gathered import Gathered
from dynid.reports.inertia_ellipsoids import Ellipsoid, ellipsoid_drawing
from dynid.reports.style import own_style
from dynid.reports.svg import Picture, drawn
from dynid.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]


def physics(gathered: Gathered) -> dict[str, Any]:
    """Return a picture of the bodies and one row per link."""
    links = gathered.result.links()
    rows = [
        {
            "link": link["link"],
            "mass": f"{link['mass_kg']:.3g}",
            "com": ", ".join(f"{value:.3f}" for value in link["com_m"]),
            "moments": ", ".join(f"{value:.2g}" for value in np.linalg.eigvalsh(tensor(link))),
            "data": sum(origin == "data" for origin in link["origin"].values()),
        }
        for link in links
    ]
    return {"pictures": [ellipsoids(gathered.robot, links)], "rows": rows, "found": gathered.result}


def tensor(link: dict[str, Any]) -> Floats:
    """Return the inertia about the centre of mass, (3, 3) [kg m^2]."""
    entries = link["inertia_com_kg_m2"]
    full = np.zeros((3, 3))
    for name, value in entries.items():
        i, j = "xyz".index(name[1]), "xyz".index(name[2])
        full[i, j] = full[j, i] = value
    return full


def pose(robot: Robot) -> Floats:
    """Return a bent pose in which no link hides the next, (n,) [rad or m]."""
    return np.array([0.8 if joint.revolute else 0.1 for joint in robot.joints])


def ellipsoids(robot: Robot, links: list[dict[str, Any]]) -> Picture:
    """Draw the arm in a bent pose from two sides, each body as the uniform ellipsoid with its mass and inertia."""
    label = "the arm from two sides with an ellipsoid for each link's mass and inertia"
    drawing = ellipsoid_drawing(robot, pose(robot), [ellipsoid(link) for link in links], label)
    return Picture(
        (drawing or drawn("ellipsoids", lambda: outlines(robot, links), label),),
        "Each ellipsoid has the mass and inertia of the link whose number it bears; blue is mostly from data, orange "
        "from the prior. The grey arm is made from the DH table.",
        "An ellipsoid far larger than the link, or far off it: the prior or the data are wrong there.",
    )


def ellipsoid(link: dict[str, Any]) -> Ellipsoid:
    """Return the uniform ellipsoid with a link's mass and inertia."""
    values, axes = np.linalg.eigh(second_moments(tensor(link)) / max(link["mass_kg"], 1e-9))
    # Why 5: a uniform ellipsoid has semi-axes of sqrt(5) standard deviations.
    size = np.sqrt(5 * np.maximum(values, 0))
    return Ellipsoid(
        str(link["link"]), link["link"], np.array(link["com_m"]), axes, size, colour(link)
    )


def colour(link: dict[str, Any]) -> str:
    """Return the colour that says whether a link's numbers are mostly from data."""
    return (
        ESTIMATED if sum(origin == "data" for origin in link["origin"].values()) >= 5 else RESIDUAL
    )


@own_style()
def outlines(robot: Robot, links: list[dict[str, Any]]) -> Figure:
    """Draw the same without PyBullet: the outlines of the ellipsoids in two planes of frame 0."""
    from matplotlib.figure import Figure as NewFigure

    poses = link_frames(robot, pose(robot)).poses
    points = np.vstack([np.zeros(3), poses[:, :3, 3]])
    figure = NewFigure(figsize=(6.4, 3.6), layout="constrained")
    for axis, (u, v) in zip(figure.subplots(1, 2), ((0, 2), (1, 2)), strict=True):
        axis.plot(points[:, u], points[:, v], "o-", color=MEASURED, lw=2, ms=3)
        for link in links:
            outline = shadow(poses[link["link"] - 1], link, (u, v))
            axis.fill(*outline.T, facecolor=colour(link), alpha=0.35, edgecolor=colour(link), lw=1)
            x, y = outline.mean(axis=0)
            axis.text(x, y, str(link["link"]), fontsize=7, ha="center", va="center")
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_xlabel(f"{'xyz'[u]} [m]", fontsize=8)
        axis.set_ylabel(f"{'xyz'[v]} [m]", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.grid(lw=0.4)
    return figure


def shadow(pose: Floats, link: dict[str, Any], pair: tuple[int, int], count: int = 48) -> Floats:
    """Return the outline of a link's ellipsoid in the plane of two axes of frame 0, (count, 2) [m]."""
    one, R, view = ellipsoid(link), pose[:3, :3], list(pair)
    centre = R @ one.centre + pose[:3, 3]
    axes = (R @ one.rotation * one.axes)[view]
    values, vectors = np.linalg.eigh(axes @ axes.T)
    angle = np.linspace(0, 2 * np.pi, count)
    ring = vectors @ (
        np.sqrt(np.maximum(values, 0))[:, None] * np.array([np.cos(angle), np.sin(angle)])
    )
    return np.asarray(centre[view] + ring.T)
