"""Scenes in Python, whose results, calls and memory are recorded. Each yields names and values."""

from tests.record.scenes import bound, data, drawn, editor, method, packages  # noqa: F401 - they fill SCENES
from tests.record.scenes.scene import ONCE as ONCE
from tests.record.scenes.scene import SCENES as SCENES
