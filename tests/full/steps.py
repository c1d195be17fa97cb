"""The steps: each gives its figures after every part, and goes on from those of a part that was done."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tests.faults.disturb import kill_at_random, two_at_once, undisturbed
from tests.faults.scenes import SCENES
from tests.full.health import coverage, kernels, properties
from tests.full.record import FOLDER, Figures
from tests.fuzz.__main__ import fuzz
from tests.fuzz.native import fuzz_native
from tests.fuzz.targets import TARGETS
from tests.robustness import numbers
from tests.robustness.__main__ import failure
from tests.robustness.case import Case
from tests.robustness.catalogue import CASES, SLOW

#: Inputs that crash a reader.
CRASHES = FOLDER / "crashes"


@dataclass(frozen=True)
class Step:
    """Something to try.

    Parameters
    ----------
    about : str
        For the page: what is tried.
    parts : callable
        Takes the figures so far.
    told : str
        For the page: what came of it, with the figures' names in braces.
    keeps : bool
        After a failure, the parts before it count; otherwise the step begins anew.
    """

    about: str
    parts: Callable[[Figures], Iterator[Figures]]
    told: str
    keeps: bool = False


def _cases(figures: Figures, *, cases: list[Case]) -> Iterator[Figures]:
    failures = [f"{case.entry}, {case.name}: {why}" for case in cases if (why := failure(case))]
    refused = sum(bool(case.says) for case in cases)
    yield {
        "tried": len(cases),
        "passed": len(cases) - len(failures),
        "entries": len({case.entry for case in cases}),
        "refused": refused,
        "taken": len(cases) - refused,
        "failures": failures,
    }


def _numbers(figures: Figures, *, seeds: int) -> Iterator[Figures]:
    same = numbers.compare(range(seeds))
    yield {
        "seeds": seeds,
        "methods": len(numbers.METHODS),
        "results": seeds * len(numbers.METHODS),
        "ways": ", ".join(same),
        "failures": [f"other bits with {way}" for way, equal in same.items() if not equal],
    }


def _kills(figures: Figures, *, scene: str, kills: int, part: int) -> Iterator[Figures]:
    """Parts of so many kills, each against an undisturbed run of its own."""
    done, codes = figures.get("kills", 0), figures.get("two_at_once", [])
    while done < kills:
        count = min(part, kills - done)
        with tempfile.TemporaryDirectory() as name:
            folder, chosen = Path(name), SCENES[scene]
            try:
                expected, seconds = undisturbed(chosen, folder)
                kill_at_random(
                    chosen, folder, kills=count, expected=expected, seconds=seconds, seed=1000 + done
                )
                codes = [*codes, two_at_once(chosen, folder, expected=expected)]
                failures = []
            except AssertionError as error:
                failures = [str(error)]
        done += 0 if failures else count
        yield {"kills": done, "two_at_once": codes, "pairs": len(codes), "failures": failures}


def _fuzz(figures: Figures, *, name: str, executions: int, part: int) -> Iterator[Figures]:
    """Rounds that go on with the inputs which the earlier ones found worth keeping."""
    corpus = FOLDER / "corpus" / name
    for folder in (corpus, CRASHES):
        folder.mkdir(parents=True, exist_ok=True)
    done, rounds, edges = figures.get("executions", 0), figures.get("rounds", 0), figures.get("edges", 0)
    while done < executions:
        rounds += 1
        count = min(part, executions - done)
        found = fuzz(name, count, seed=rounds, crashes=CRASHES, corpus=corpus)
        done, edges = done + found.executions, max(edges, found.edges)
        failures = [found.problem] if found.problem else []
        yield {"executions": done, "rounds": rounds, "edges": edges, "failures": failures}


def _native(figures: Figures, *, files: int, part: int) -> Iterator[Figures]:
    CRASHES.mkdir(parents=True, exist_ok=True)
    done = figures.get("files", 0)
    while done < files:
        count = min(part, files - done)
        crashed = fuzz_native(count, seed=1, crashes=CRASHES, begin=done)
        done += count
        failures = [f"{crashed} of {count} files, kept in {CRASHES}"] if crashed else []
        yield {"files": done, "failures": failures}


def steps(share: float = 1.0) -> dict[str, Step]:
    """The steps by name, the quick ones first.

    Parameters
    ----------
    share : float
        Of the kills, executions and seeds; 1 for a page that says what it promises.
    """

    def of(count: int) -> int:
        return max(1, round(share * count))

    found = {
        "cases": Step(
            "bad and hard inputs, by name: message, exit code, files left",
            partial(_cases, cases=[*CASES, *SLOW] if share == 1 else CASES[:10]),
            "{passed} of {tried} cases over {entries} entry points as promised: {refused} refused in one "
            "sentence, {taken} taken with the promised result",
        ),
        "numbers": Step(
            "the same bits again",
            partial(_numbers, seeds=of(20)),
            "{results} results ({methods} methods, {seeds} seeds) bit for bit the same with {ways}",
        ),
    }
    found["properties"] = Step(
        "property tests: rigid motions, scales, orders, orientation, seeds and workers, far from the origin",
        partial(properties, examples=of(100)),
        "{properties} properties on {examples} random tasks each",
    )
    found["kernels"] = Step(
        "kernels as plain Python, which checks every index",
        kernels,
        "{kernels} kernels in {pieces} pieces of work, largest relative difference {apart:.0e}",
    )
    for scene, kills in (("build", 33), ("build of two", 33), ("sweep", 34)):
        found[f"kills_{scene.replace(' ', '_')}"] = Step(
            f"kill -9 at random moments: {scene}",
            partial(_kills, scene=scene, kills=of(kills), part=11),
            "{kills} kills: what was left was whole, and reruns gave what an undisturbed run gives; so did "
            "two at once, {pairs} times",
        )
    for name in TARGETS:
        found[f"fuzz_{name}"] = Step(
            f"fuzzing, guided by coverage: {name}",
            partial(_fuzz, name=name, executions=of(200_000), part=20_000),
            "{executions} executions in {rounds} rounds, {edges} edges covered, no crash",
        )
    found["fuzz_native"] = Step(
        "mutated files of formats that compiled code reads",
        partial(_native, files=of(5_000), part=500),
        "{files} files, no crash but as an error of ours",
    )
    found["coverage"] = Step(
        "the test suite, with coverage by lines",
        coverage,
        "{tests} tests passed, {skipped} skipped, {warnings} warnings; {least:.1f} % of lines or more",
        keeps=True,
    )
    return found
