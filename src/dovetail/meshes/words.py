"""The facts of a checked pair as text, and as numbers for a program."""

from typing import Any

import numpy as np

from dovetail.meshes.check import Check
from dovetail.meshes.conversion import Conversion
from dovetail.meshes.exactness import REACH, Exactness
from dovetail.meshes.gaps import Gaps
from dovetail.meshes.hold import Hold
from dovetail.meshes.read import Mesh
from dovetail.types import Vec3
from dovetail.workcell.planar import import_shapely

_RESTING = 5e-5
"""Way to what stops a plug up to which it rests there [m]."""


def rows(check: Check, *, is_axis_given: bool) -> list[tuple[str, str]]:
    """Return what is known of a pair: a name and a text for each fact.

    Args:
        check: The pair.
        is_axis_given: Whether the way in was given, not found.
    """
    pair, body = check.conversion, check.inertia
    moments = 1e9 * np.linalg.eigvalsh(body.inertia)
    both = pair.plug, pair.socket
    end = "through the socket" if pair.is_through else "down to a floor"
    found = "given" if is_axis_given else "found"
    if not is_axis_given and pair.axis != "-z":
        found += " (if that is not meant, give --axis or swap the files)"
    return [
        ("plug", _read(pair.plug, "plug")),
        ("socket", _read(pair.socket, "socket")),
        *(("", f"{one.name}: {note}") for one in both for note in one.notes),
        ("mass of the plug", f"{1e3 * body.mass:.3g} g at {pair.density:g} kg/m3"),
        ("its inertia", " ".join(f"{m:.3g}" for m in moments) + " g mm2, principal"),
        ("way in", f"along {pair.axis} of the files, {found}; {end}"),
        ("frame", _frame(pair)),
        ("depth", f"{1e3 * pair.depth:.2f} mm below the mouth"),
        *_gap(check),
        (
            "convex pieces",
            ", ".join(f"{name} {count}" for name, count in _counts(check).items())
            or "cannot be built",
        ),
        *([("how exact", _exact(pair.exactness))] if pair.exactness else []),
        *_hold(check.hold),
        *_stand_in(check),
        *_higher(pair),
    ]


def _frame(pair: Conversion) -> str:
    """Say where the part's frame is in the files: a fixture's pose is that frame's."""
    x, y, z = 1e3 * pair.in_files(np.zeros(3))
    along_x, along_z = (_axis(pair.turn[row]) for row in (0, 2))
    return (
        f"the fixture's 0 0 0, the middle of the mouth, is at ({x:.2f}, {y:.2f}, "
        f"{z:.2f}) mm of the files; its x is {along_x}, its z {along_z} of the files"
    )


def _axis(direction: Vec3) -> str:
    """Return the name of an axis with its sign, as +x."""
    at = int(np.abs(direction).argmax())
    return f"{'+' if direction[at] > 0.0 else '-'}{'xyz'[at]}"


def _higher(pair: Conversion) -> list[tuple[str, str]]:
    """Say how far above what stops it the plug stands, where that is not next to it."""
    way = pair.exactness.stop_mesh if pair.exactness else None
    if way is None or way < _RESTING:
        return []
    return [
        (
            "note",
            f"the plug stands {1e3 * way:.2f} mm above where the socket stops it, and "
            "the task is done there; where it is meant to rest, move it in CAD",
        )
    ]


def _counts(check: Check) -> dict[str, int]:
    """Return the number of convex pieces of each part, if they can be built."""
    names = ("plug and what holds it" if check.conversion.stalk else "plug", "socket")
    counts = (len(part.primitives) for part in check.parts)
    return dict(zip(names, counts, strict=False))


def _stand_in(check: Check) -> list[tuple[str, str]]:
    """Say by what the simulation holds a plug that is too short for its fingers."""
    if (stalk := check.conversion.stalk) is None:
        return []
    what = "a stalk" if check.hold.stalk else "tips of fingers"
    span = f"{1e3 * stalk.low:.1f} to {1e3 * stalk.high:.1f} mm above the mouth"
    mass = f"{1e3 * check.conversion.mass:.3g} g in all"
    return [
        ("in the simulation", f"{what}, {span}, makes it long enough to hold; {mass}")
    ]


def _read(mesh: Mesh, part: str) -> str:
    low, high = mesh.box
    size = " x ".join(f"{1e3 * side:.4g}" for side in high - low)
    state = "closed" if mesh.was_closed else "not closed, repaired"
    name = "" if mesh.name == part else f"{mesh.name}: "
    return (
        f"{name}{len(mesh.faces)} triangles, {state}, {size} mm "
        f"(units {mesh.units}, {mesh.units_from})"
    )


def _gap(check: Check) -> list[tuple[str, str]]:
    if not check.clearance.is_measured:
        return [("gap", "none: the plug faces no wall of the socket within 3 mm")]
    quartiles = ", ".join(f"{1e3 * q:.3f}" for q in check.clearance.quartiles)
    level, at = check.clearance.tightest
    x, y, z = 1e3 * _place(check.conversion, level, at)
    least = 1e3 * float(level.gaps[at])
    own = check.pieces if check.pieces and check.pieces.is_measured else None
    pieces = [f"{1e3 * q:.3f}" for q in own.quartiles] if own else []
    return [
        ("gap all round", f"{quartiles} mm (quartiles)"),
        *([("of the pieces", ", ".join(pieces) + " mm")] if own else []),
        (
            "tightest",
            f"{least:.3f} mm, {-1e3 * level.z:.2f} mm below the mouth, at ({x:.2f}, "
            f"{y:.2f}, {z:.2f}) mm of the files",
        ),
    ]


def _place(pair: Conversion, level: Gaps, at: int) -> Vec3:
    """Return the place of a gap in the files' axes [m]."""
    return pair.in_files(np.append(level.points[at], level.z))


def _exact(exact: Exactness) -> str:
    """Say how far the pieces are off the meshes."""
    return (
        f"clearance {1e3 * exact.low:+.3f} to {1e3 * exact.high:+.3f} mm beside the "
        f"meshes' (5 to 95 % of the walls, allowed {1e3 * exact.allowed:.3f}; worst "
        f"{1e3 * exact.worst:.3f}); pushed deeper, the meshes stop "
        f"{_stop(exact.stop_mesh)}, the pieces {_stop(exact.stop_pieces)}"
    )


def _stop(way: float | None) -> str:
    if way is None:
        return f"nowhere within {1e3 * REACH:g} mm"
    return f"after {1e3 * way:.3f} mm"


def _hold(hold: Hold) -> list[tuple[str, str]]:
    grip, stalk = hold.used_grip, hold.used_stalk
    said: list[tuple[str, str]] = []
    if grip is not None:
        turn = round((float(np.rad2deg(grip.turn)) + 90.0) % 180.0 - 90.0, 1)
        to_x = ""
        if turn:
            to_x = (
                "; in the simulation they close along x: turn both files by "
                f"{-turn:g} deg about the frame's z, and check them again"
            )
        said.append(
            (
                "fingers",
                f"{1e3 * grip.width:.1f} mm apart, closing at {turn:g} deg from x, "
                f"from {1e3 * grip.low:.1f} mm above the mouth; they touch "
                f"{1e3 * grip.touching:.1f} mm of height, down to a depth of "
                f"{1e3 * hold.bare:.1f} mm{to_x}",
            )
        )
    if stalk is not None:
        shape = "hollow" if _has_cutout(stalk.outline) else "solid"
        said.append(
            (
                "stalk",
                f"{shape}, {1e6 * stalk.outline.area:.0f} mm2 on the plug's top, "
                f"{1e3 * stalk.low:.1f} mm above the mouth, and "
                f"{1e3 * (stalk.high - stalk.low):.0f} mm high; glue or "
                "print it on. Fingers alone reach a depth of "
                f"{1e3 * hold.bare:.1f} mm",
            )
        )
    return said or [("fingers", "no place found on the plug")]


def _has_cutout(outline: Any) -> bool:
    shapely = import_shapely()
    return bool(shapely.get_num_interior_rings(shapely.get_parts(outline)).any())


def numbers(check: Check) -> dict[str, Any]:
    """Return the facts of a pair as plain data, lengths in m."""
    pair, hold, body = check.conversion, check.hold, check.inertia
    exact = pair.exactness
    own = check.pieces if check.pieces and check.pieces.is_measured else None
    is_measured = check.clearance.is_measured
    level, at = check.clearance.tightest if is_measured else (None, 0)
    grip = hold.used_grip
    return {
        "go": check.is_go,
        "problems": list(check.problems),
        "plug": _mesh(pair.plug),
        "socket": _mesh(pair.socket),
        "density": pair.density,
        "mass": body.mass,
        "centre": body.centre.tolist(),
        "inertia": body.inertia.tolist(),
        "axis": pair.axis,
        "frame": {
            "origin": pair.in_files(np.zeros(3)).tolist(),
            "x": pair.turn[0].tolist(),
            "z": pair.turn[2].tolist(),
        },
        "depth": pair.depth,
        "through": pair.is_through,
        "gap": {
            "quartiles": list(check.clearance.quartiles) if is_measured else None,
            "pieces": list(own.quartiles) if own else None,
            "least": float(level.gaps[at]) if level else None,
            "at": _place(pair, level, at).tolist() if level else None,
        },
        "pieces": _counts(check),
        "exactness": exact._asdict() | {"stop_error": exact.stop_error}
        if exact
        else None,
        "hold": {
            "kind": hold.kind,
            "reach": hold.reach,
            "fingers_alone": hold.bare,
            "width": grip.width if grip else None,
            "turn": grip.turn if grip else None,
            "low": grip.low if grip else None,
        },
    }


def _mesh(mesh: Mesh) -> dict[str, Any]:
    low, high = mesh.box
    return {
        "name": mesh.name,
        "triangles": len(mesh.faces),
        "was_closed": mesh.was_closed,
        "units": mesh.units,
        "units_from": mesh.units_from,
        "size": (high - low).tolist(),
        "volume": mesh.volume,
        "notes": list(mesh.notes),
    }
