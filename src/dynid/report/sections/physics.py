"""Physical possibility: the bodies of the full set as ellipsoids on the arm, and where their numbers come from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import frames
from dynid.report.evidence import Evidence
from dynid.report.figures import ESTIMATED, RESIDUAL
from dynid.report.sections.interface import Picture, Section
from dynid.report.svg import as_svg, page_style
from dynid.robot import Robot

Floats = NDArray[np.float64]


class Physics(Section):
    """A picture of the bodies and a table of them."""

    title, anchor = "Physical possibility", "physics"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return the picture and one row a link."""
        links = evidence.found.physical.links()
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
        return {"pictures": [ellipsoids(evidence.robot, links)], "rows": rows, "found": evidence.found}


def tensor(link: dict[str, Any]) -> Floats:
    """Return the inertia about the centre of mass, (3, 3) [kg m^2]."""
    entries = link["inertia_com_kg_m2"]
    full = np.zeros((3, 3))
    for name, value in entries.items():
        i, j = "xyz".index(name[1]), "xyz".index(name[2])
        full[i, j] = full[j, i] = value
    return full


def ellipsoids(robot: Robot, links: list[dict[str, Any]]) -> Picture:
    """Draw the arm in a bent pose from two sides, each body as the uniform ellipsoid with its mass and inertia."""
    from matplotlib.figure import Figure

    q = np.array([0.4 if joint.revolute else 0.1 for joint in robot.joints])
    poses = frames(robot, q)
    points = np.vstack([np.zeros(3), poses[:, :3, 3]])
    with page_style("ellipsoids"):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        for axis, (u, v) in zip(figure.subplots(1, 2), ((0, 2), (1, 2)), strict=True):
            axis.plot(points[:, u], points[:, v], "o-", color="#8c8c8c", lw=2, ms=3)
            for link in links:
                pose = poses[link["link"] - 1]
                measured = sum(origin == "data" for origin in link["origin"].values())
                outline = shadow(pose, link, (u, v))
                colour = ESTIMATED if measured >= 5 else RESIDUAL
                axis.fill(*outline.T, facecolor=colour, alpha=0.35, edgecolor=colour, lw=1)
                x, y = outline.mean(axis=0)
                axis.text(x, y, str(link["link"]), fontsize=7, ha="center", va="center")
            axis.set_aspect("equal", adjustable="datalim")
            axis.set_xlabel(f"{'xyz'[u]} [m]", fontsize=8)
            axis.set_ylabel(f"{'xyz'[v]} [m]", fontsize=8)
            axis.tick_params(labelsize=7)
            axis.grid(lw=0.4)
        drawing = as_svg(figure, "the arm from two sides with an ellipsoid for each link's mass and inertia")
    return Picture(
        drawing,
        "Each ellipsoid has its link's mass and inertia, in frame 0; blue is mostly from data, orange from the prior.",
        "An ellipsoid far larger than the link, or far off it: the prior or the data are wrong there.",
    )


def shadow(pose: Floats, link: dict[str, Any], pair: tuple[int, int], count: int = 48) -> Floats:
    """Return the outline of a link's equivalent ellipsoid in the plane of two axes of frame 0, (count, 2) [m]."""
    inertia, R, view = tensor(link), pose[:3, :3], list(pair)
    sigma = (np.trace(inertia) / 2 * np.eye(3) - inertia) / max(link["mass_kg"], 1e-9)
    centre = R @ np.array(link["com_m"]) + pose[:3, 3]
    # Why 5: a uniform ellipsoid has semi-axes of sqrt(5) standard deviations.
    values, axes = np.linalg.eigh(5 * (R @ sigma @ R.T)[np.ix_(view, view)])
    angle = np.linspace(0, 2 * np.pi, count)
    ring = axes @ (np.sqrt(np.maximum(values, 0))[:, None] * np.array([np.cos(angle), np.sin(angle)]))
    return np.asarray(centre[view] + ring.T)
