"""Print the outcomes of the corpus."""

from __future__ import annotations

from collections.abc import Sequence

from tools.corpus.run import DEFORMED, REFUSED, WRONG, Outcome


def report(outcomes: Sequence[Outcome], methods: Sequence[str]) -> str:
    """Return a table of counts, then every refused and every wrong file with its reason."""
    verdicts = (DEFORMED, REFUSED, WRONG)
    lines = [f"{'method':<8} {'tried':>8} {'deformed':>9} {'refused with reason':>20} {'wrong':>6}"]
    for method in methods:
        own = [outcome.verdict for outcome in outcomes if outcome.method == method]
        counts = [own.count(verdict) for verdict in verdicts]
        lines.append(f"{method:<8} {len(own):>8} {counts[0]:>9} {counts[1]:>20} {counts[2]:>6}")
    for verdict in (REFUSED, WRONG):
        texts: dict[tuple[str, str], list[str]] = {}
        for outcome in outcomes:
            if outcome.verdict == verdict:
                texts.setdefault((outcome.name, outcome.text), []).append(outcome.method)
        lines += ["", f"{verdict}:"] if texts else []
        for (name, text), by in texts.items():
            which = "" if len(by) == len(methods) else f" ({', '.join(by)})"
            lines += [f"  {name}{which}", f"    {text}"]
    return "\n".join(lines)
