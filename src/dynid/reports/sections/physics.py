"""Physical possibility: the bodies of the full set as ellipsoids on the arm, and where their numbers come from."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.reports.gathered import Gathered
from dynid.reports.section_figures import bodies_figure, inertia_tensor
from dynid.reports.svg import Picture, drawn


def physics(gathered: Gathered) -> dict[str, Any]:
    """Return a picture of the bodies and one row per link."""
    links = gathered.result.links()
    rows = [
        {
            "link": link["link"],
            "mass": f"{link['mass_kg']:.3g}",
            "com": ", ".join(f"{value:.3f}" for value in link["com_m"]),
            "moments": ", ".join(
                f"{value:.2g}" for value in np.linalg.eigvalsh(inertia_tensor(link))
            ),
            "data": sum(origin == "data" for origin in link["origin"].values()),
        }
        for link in links
    ]
    picture = Picture(
        drawn(
            lambda: bodies_figure(gathered.robot, links),
            "the arm from two sides with an ellipsoid for each link's mass and inertia",
        ),
        "Each ellipsoid has the mass and inertia of the link whose number it bears; blue is mostly from data, orange "
        "from the prior. The grey line joins the frames of the DH table.",
        "An ellipsoid far larger than the link, or far off it: the prior or the data are wrong there.",
    )
    return {"pictures": [picture], "rows": rows, "found": gathered.result}
