"""docs/measures.md explains every measure, and the page of examples shows every picture of its script."""

import runpy
from pathlib import Path

from eval.metrics import METRICS

DOCS = Path(__file__).parents[3] / "docs"
SCRIPT = runpy.run_path(str(DOCS / "measures.py"))
PAGE, EXAMPLES = ((DOCS / f"measures{name}.md").read_text() for name in ("", "_examples"))


def test_every_measure_is_explained_and_every_picture_is_there():
    assert [name for name in METRICS if f"`{name}`" not in PAGE] == []
    pictures = [part.partition(")")[0] for part in EXAMPLES.split("](figures/")[1:]]
    assert sorted(pictures) == [f"measures_{name}.png" for name in sorted(SCRIPT["EXAMPLES"])]
    for name in pictures:
        assert 1000 < (DOCS / "figures" / name).stat().st_size < 150_000
