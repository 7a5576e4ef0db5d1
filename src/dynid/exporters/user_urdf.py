"""The user's own URDF with new inertial blocks: every other byte stays as it is.

What hangs on a moving link by fixed joints, or by joints of its own such as fingers, keeps its block; the link itself
gets the rest of the identified body.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.sax.saxutils import escape

from dynid.errors import NotPhysical
from dynid.estimation.possible_set import smallest_eigenvalues
from dynid.exporters.code import rendered
from dynid.exporters.full_model import FullModel
from dynid.model.attached import Attached, attached, hanging
from dynid.model.parameters import body_of, moved
from dynid.robot import Body, Robot
from dynid.text import xml_comment


def rewritten(path: Path, robot: Robot, full: FullModel, head: str) -> str:
    """Return the text of a URDF with the inertial blocks of the identified links replaced.

    Args:
        path: the URDF.
        robot: the arm.
        full: its bodies.
        head: where its numbers come from.
    """
    place = attached(path, robot)
    moving = [joint.name for joint in place.urdf.joints if joint.moves]
    new = {}
    for i, (joint, body) in enumerate(zip(place.joints, full.bodies, strict=True), start=1):
        own = _own_share(place, joint.child, moved(body, place.to_dh[i - 1]))
        new[joint.child] = (own, full.origin_of_link(i))
        for fixed, _ in place.urdf.behind(joint.child, moving):
            if place.urdf.bodies[fixed.child] is None:
                note = "an empty frame: without this block PyBullet gives it 1 kg"
                new[fixed.child] = (Body(0.0), note)
    return _replaced(path, new, head)


def _own_share(place: Attached, link: str, body: Body) -> Body:
    """Return a link's body without what hangs on it."""
    parts, total = hanging(place.urdf, link, place.names), body.parameters()
    rest = total - sum(parts.values())
    if parts and smallest_eigenvalues(rest) <= -1e-12 and smallest_eigenvalues(total) > 0:
        raise NotPhysical(
            f"what hangs on link '{link}' ({', '.join(sorted(parts))}) is heavier than the identified body",
            fix="correct or remove the <inertial> of these links in the URDF",
        )
    return body_of(rest)


def _replaced(path: Path, new: dict[str, tuple[Body, str]], head: str) -> str:
    """Splice new inertial blocks into the text, so that nothing else is touched."""
    text = path.read_bytes().decode("utf-8")
    # What is commented out is no element.
    seen = re.sub("<!--.*?-->", lambda match: " " * len(match[0]), text, flags=re.DOTALL)
    comment = xml_comment(f"inertial blocks of {', '.join(new)} by dynid: {head}")
    top = seen.index("<robot")
    pieces = [(top, top, f"<!--{comment}-->\n")]
    for link, (body, note) in new.items():
        name = rf"""<link\s(?:[^>]*?\s)?name\s*=\s*["']{re.escape(escape(link))}["'][^>]*?"""
        element = re.search(rf"{name}(?:/>|>.*?</link\s*>)", seen, re.DOTALL)
        assert element is not None
        own = re.compile(r"<inertial\b.*?</inertial\s*>", re.DOTALL).search(seen, *element.span())
        block = rendered("inertial.xml", body=body, note=note).strip().replace("\n", "\n    ")
        start = end = seen.index(">", element.start()) + 1
        if own:
            start, end = own.span()
        elif seen[end - 2] == "/":
            start, block = end - 2, f">\n    {block}\n  </link>"
        else:
            block = f"\n    {block}"
        pieces.append((start, end, block))
    for start, end, piece in sorted(pieces, reverse=True):
        text = text[:start] + piece + text[end:]
    return text
