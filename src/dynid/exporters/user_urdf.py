"""The user's own URDF with new inertial blocks: every other byte stays as it is.

What hangs on a moving link by fixed joints, or by joints of its own such as fingers, keeps its block; the link itself
gets the rest of the identified body. Where no such rest exists, fixed parts are emptied and the link carries all.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from dynid.errors import NotPhysical
from dynid.estimation.possible_set import smallest_eigenvalues
from dynid.exporters.code import rendered
from dynid.exporters.full_model import FullModel
from dynid.model.attached import Attached, attached, hanging
from dynid.model.parameters import body_of, moved
from dynid.robot import Body
from dynid.text import xml_comment

if TYPE_CHECKING:
    from dynid.exporters.interface import IdentifiedArm


#: What is left of a link when all its mass hangs on it, up to rounding.
NOTHING = 1e-12


def rewritten(path: Path, arm: IdentifiedArm, full: FullModel) -> str:
    """Return the text of a URDF with the inertial blocks of the identified links replaced.

    Args:
        path: the URDF.
        arm: what is written.
        full: its bodies.
    """
    place = attached(path, arm.robot)
    moving = [joint.name for joint in place.urdf.joints if joint.moves]
    new = {}
    for i, (joint, body) in enumerate(zip(place.joints, full.bodies, strict=True), start=1):
        own, emptied = _own_share(place, joint.child, moved(body, place.to_dh[i - 1]))
        new[joint.child] = (own, full.origin_of_link(i))
        note = f"its mass is in {joint.child}: link {i} was identified as one body"
        new |= dict.fromkeys(emptied, (Body(0.0), note))
        for fixed, _ in place.urdf.behind(joint.child, moving):
            if place.urdf.bodies[fixed.child] is None:
                note = "an empty frame: without this block PyBullet gives it 1 kg"
                new[fixed.child] = (Body(0.0), note)
    return _replaced(path, new, arm.head(str))


def _own_share(place: Attached, link: str, body: Body) -> tuple[Body, list[str]]:
    """Return a link's body without what hangs on it, and the links that had to be emptied."""
    behind, parts = place.urdf.behind(link, place.names), hanging(place.urdf, link, place.names)
    total = body.parameters()
    rest = total - sum(parts.values())
    if not parts or smallest_eigenvalues(rest) > -NOTHING or smallest_eigenvalues(total) <= 0:
        return body_of(rest), []
    own_joint = {joint.child for joint, _ in behind if joint.moves}
    free = {joint.child for joint, _ in behind if joint.parent in own_joint} | own_joint
    rest = total - sum(part for name, part in parts.items() if name in free)
    if smallest_eigenvalues(rest) <= -NOTHING:
        raise NotPhysical(
            f"what moves on link '{link}' by itself ({', '.join(sorted(free))}) is heavier than the identified body"
        )
    return body_of(rest), [name for name in parts if name not in free]


def _replaced(path: Path, new: dict[str, tuple[Body, str]], head: str) -> str:
    """Splice new inertial blocks into the text, so that nothing else is touched."""
    text = path.read_bytes().decode("utf-8")
    # What is commented out is no element.
    seen = re.sub("<!--.*?-->", lambda match: " " * len(match[0]), text, flags=re.DOTALL)
    comment = xml_comment(f"inertial blocks of {', '.join(new)} by dynid: {head}")
    pieces = [(seen.index("<robot"), seen.index("<robot"), f"<!--{comment}-->\n")]
    for link, (body, note) in new.items():
        name = rf"""<link\s(?:[^>]*?\s)?name\s*=\s*["']{re.escape(escape(link))}["'][^>]*?"""
        element = re.search(rf"{name}(?:/>|>.*?</link\s*>)", seen, re.DOTALL)
        assert element is not None
        own = re.compile(r"<inertial\b.*?</inertial\s*>", re.DOTALL).search(seen, *element.span())
        at = (own or element).start()
        before = text[text.rfind("\n", 0, at) + 1 : at]
        indent, around = before if not before.strip() else "    ", "{}"
        if own:
            start, end = own.span()
        else:
            end = seen.index(">", at) + 1
            start = end - 2 * (closed := seen[end - 2] == "/")
            around = f"\n{indent}  {{}}"
            around = f">{around}\n{indent}</link>" if closed else around
            indent += "  "
        block = rendered("inertial.xml", body=body, note=note).strip().replace("\n", f"\n{indent}")
        pieces.append((start, end, around.format(block)))
    for start, end, piece in sorted(pieces, reverse=True):
        text = text[:start] + piece + text[end:]
    return text
