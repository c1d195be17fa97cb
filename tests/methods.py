"""Methods that the project ships, and your own method if the environment variable METHOD names it."""

import os
from collections.abc import Callable
from functools import cache

import pytest
import yaml
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf

from eval import CONFIGURATION
from eval.run.targets import instantiate
from sshade import DeformationResult

OURS = ("sshade.", "baselines.")
#: Sizes of the tetrahedra or cubes that some methods deform.
COARSE = {"edge": 0.1, "cells": 16}
#: Learned methods: they meet handles softly, and a test takes few steps.
LEARNED = ("implicit_arap_cpu", "implicit_arap_paper")


@cache
def _composed(name: str) -> DictConfig:
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return compose("config", overrides=[f"method={name}"])


def configured(name: str, *overrides: str) -> Callable[..., DeformationResult]:
    """Return a method as its YAML configures it, coarse; a learned method gets the sizes of its warm-up."""
    config = OmegaConf.merge(_composed(name), OmegaConf.from_dotlist([*overrides]))
    options = OmegaConf.to_container(config.method, resolve=True)
    if name in LEARNED:
        pytest.importorskip("torch", reason="the extra torch is not installed")
        options |= options["warm_up"]
    options |= {option: size for option, size in COARSE.items() if option in options}
    return instantiate({**options, "_partial_": True})


def methods(*folders: str) -> list[str]:
    """Return the names of the YAMLs in folders of ``conf/method`` that name a function of the project.

    The folder "" is ``conf/method`` itself. ``METHOD=mymethod pytest tests/contract`` tests `mymethod`, too.
    `external` is left out, because it needs a program to become a method.
    """
    root = CONFIGURATION / "method"
    found = [path for folder in folders for path in sorted((root / folder).glob("*.yaml"))]
    own = [path for path in found if _target(path).startswith(OURS) and path.stem != "external"]
    names = [str(path.relative_to(root).with_suffix("")) for path in own]
    asked = os.environ.get("METHOD")
    return [*names, asked] if asked and "" in folders and asked not in names else names


def _target(path) -> str:
    return yaml.safe_load(path.read_text(encoding="utf-8")).get("_target_", "sshade.")
