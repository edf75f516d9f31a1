"""Pictures of what each user asks for, and of telling users apart."""

from functools import partial

from pipeline.report.figures import envelope, identification
from pipeline.report.pictures.picture import Picture, picture
from pipeline.report.results import POSITION, Results
from pipeline.report.wording import counted, listed, percent, variant_phrase


def envelopes(results: Results, shown: list[str]) -> Picture:
    """What an item takes from validity, by clearance."""
    found = results.envelope
    parts = []
    for variant in shown:
        cells = [c for by in found["envelope"][variant].values() for c in by.values() if c["truth_m"] is not None]
        errors = [abs(c["error_m"]) for c in cells if c["error_m"] is not None]
        parts.append(
            f"{variant_phrase(variant)} finds {len(errors)} of {counted(len(cells), 'true envelope')}"
            + (f", at most {1000 * max(errors):.1f} mm off" if errors else "")
        )
    alt = f"What an item takes from the chance that a path is valid, against clearance: {listed(parts)}."
    caption = (
        "Dose and response: what an added item takes from P(valid) of a path that is clear of everything else, by the "
        "clearance at which it passes the item (bands: 95 % intervals over seeds and items). Truth falls from 1 "
        "to 0 at the user's margin. Below the curves, the clearance at which half of the response is gone."
    )
    users = [u for u in results.users if any(c["truth_m"] is not None for c in found["envelope"][shown[0]][u].values())]
    wide, narrow = (partial(envelope.draw, found["curves"], found["envelope"], shown, users, c) for c in (4, 2))
    return picture("envelope", caption, alt, wide, narrow)


def identified(results: Results, shown: list[str]) -> Picture:
    """Which user it was, against the number of labelled paths."""
    found = results.identification
    variants = [*shown, POSITION]
    last = max(found["identification"][variants[0]], key=_paths)
    parts = [f"{variant_phrase(v)} {percent(found['identification'][v][last]['mean'])}" for v in variants]
    ideal = found["identification"][variants[0]][last]["ideal"]
    alt = (
        f"Share of demonstrators recognised after {_paths(last)} labelled paths: {listed(parts)}; an observer who "
        f"knows the rules {percent(ideal)}."
    )
    told = f"{counted(found['telling_scenes'], 'scene')} in which {_paths(last)} paths nearly always tell any two users"
    middle = f"Second panel: the {told} apart. " if "telling" in results.identified else ""
    caption = (
        f"First panel: how often the true one of the {len(results.users)} users is the most probable, after k "
        f"labelled paths in one of {found['scenes']} new scenes; bands are 95 % intervals. "
        f"{middle}Last panel: how often a user who "
        "minds plates only is called none of these (lines with marks), and how often a known one is (dotted), "
        f"at a level of {percent(found['level'], 0)} (thin line)."
    )
    curve = results.identified
    wide, narrow = (
        partial(identification.draw, curve, variants, found["chance"], found["level"], columns) for columns in (3, 1)
    )
    return picture("identification", caption, alt, wide, narrow)


def _paths(key: str) -> int:
    return int(key.removeprefix("k"))
