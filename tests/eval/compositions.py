"""Compose the project's configuration with Hydra, for tests of its contents."""

from functools import cache

from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from eval import CONFIGURATION


def composed(*overrides: str) -> DictConfig:
    """Return the configuration of a command line, with Hydra's own settings; cached, do not change."""
    config = _composed(overrides)
    HydraConfig.instance().set_config(config)
    return config


@cache
def _composed(overrides: tuple[str, ...]) -> DictConfig:
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return compose("config", overrides=list(overrides), return_hydra_config=True)
