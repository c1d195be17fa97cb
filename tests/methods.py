"""The methods that the project ships, and one of your own where the variable METHOD names it."""

from __future__ import annotations

import os

import yaml

from sshade.cli.configuration import CONFIGURATION

OURS = ("sshade.", "baselines.")


def methods(*folders: str) -> list[str]:
    """Names of YAMLs in folders of ``conf/method``, "" for itself, whose functions are the project's.

    ``METHOD=mymethod pytest tests/contract`` holds that one to the contract, too.
    """
    root = CONFIGURATION / "method"
    found = [path for folder in folders for path in sorted((root / folder).glob("*.yaml"))]
    own = [path for path in found if _target(path).startswith(OURS)]
    names = [str(path.relative_to(root).with_suffix("")) for path in own]
    asked = os.environ.get("METHOD")
    return [*names, asked] if asked and "" in folders and asked not in names else names


def _target(path) -> str:
    return yaml.safe_load(path.read_text(encoding="utf-8")).get("_target_", "sshade.")
