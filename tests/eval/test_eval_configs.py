"""Every YAML file of conf composes, names existing functions, and passes them parameters that they take."""

import inspect
from collections.abc import Callable
from typing import get_origin

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from eval import CONFIGURATION
from eval.run.config import ABOUT_DATASET, composed
from eval.run.sweep import prepared
from eval.run.targets import OWN_KEYS, check_parameters, instantiate, locate, parameter_hints
from sshade import deform
from sshade.problem.options import GROUPS
from sshade.problem.task import Method
from tests.methods import methods


def names(group):
    folder = CONFIGURATION.joinpath(group)
    return sorted(f.name.removesuffix(".yaml") for f in folder.iterdir() if f.name.endswith(".yaml"))


METHODS = methods("", "peer", "transfer")
#: Settings of the solver, which methods share, and those that a method has of its own.
COMMON = {"tolerance": 7e-4, "max_iterations": 77, "start": "rest"}
OWN = {"accelerated_arap_sr": {"tolerance"}, "peer/neo_hookean": {"max_iterations"}}


def method_of(config):
    return OmegaConf.to_container(config.method, resolve=True)


@pytest.mark.parametrize("name", METHODS)
def test_method_composes_and_names_every_parameter_of_its_function(name):
    """A row then records every parameter of its method, and a command line can change every parameter.

    What a file sets itself stays so, and what several methods share follows the common settings.
    """
    common = {f"solver.{key}": value for key, value in COMMON.items()} | {"proxy.vertices": 111}
    config = composed([f"method={name}", "proxy.better=222", *(f"{k}={v}" for k, v in common.items())])
    assert config.label == name
    plain = method_of(config)
    file = OmegaConf.to_container(OmegaConf.load(CONFIGURATION / f"method/{name}.yaml"), resolve=False)
    own = {key: value for key, value in file.items() if key != "defaults" and "${" not in str(value)}
    assert own.items() <= plain.items()
    shared = COMMON | {"vertices": 222 if plain.get("method") in ("fast", "fine") else 111}
    differ = {key for key in shared if plain.get(key, shared[key]) != shared[key]}
    assert differ == OWN.get(name, set())
    function = instantiate(plain).func
    hints = parameter_hints(function)
    assert set(inspect.signature(Method.__call__).parameters) - {"self"} <= set(hints)
    warm_up = {key: plain[key] for key in ("method",) if key in plain} | (plain.get("warm_up") or {})
    check_parameters(function, warm_up, target=name)
    taken = {key for key, hint in hints.items() if get_origin(hint) is not Callable} - {"options"}
    if function is deform:
        taken = {"method", *(option for names in GROUPS.values() for option in names)}
    assert set(plain) - set(OWN_KEYS) == taken - {"task", "seed", "progress"}


@pytest.mark.parametrize("name", names("dataset"))
def test_dataset_composes_and_names_a_loader(name):
    plain = OmegaConf.to_container(composed([f"dataset={name}"]).dataset, resolve=True)
    about = {key: plain.pop(key) for key in ABOUT_DATASET if key in plain}
    target = plain.pop("_target_")
    check_parameters(locate(target), plain, target=target)
    if "cases" in about:
        assert set(inspect.signature(locate(about["cases"])).parameters) >= {"root", "subjects", "poses"}


@pytest.mark.parametrize("name", names("experiment"))
def test_experiment_composes_with_the_first_and_last_values_that_it_sweeps(name):
    """Cases and seeds are left out, because they are plain values in every configuration."""
    config = composed([f"experiment={name}"])
    assert config.hydra.mode.name == "MULTIRUN"
    assert config.run.experiment == (name if name != "track" else "bodies_25k")
    assert config.hydra.sweep.dir.endswith(f"out/runs/{config.run.experiment}")
    swept = {}
    for key, of in config.hydra.sweeper.params.items():
        if "glob(" not in str(of) and key not in ("subject", "pose", "seed"):
            override = OverridesParser.create().parse_override(f"{key}={of}")
            swept[key] = [*override.sweep_string_iterator()] if override.is_sweep_override() else [of]
    for values in {tuple(f"{key}={of[k]}" for key, of in swept.items()) for k in (0, -1)}:
        composed([f"experiment={name}", *values])


def test_a_glob_finds_the_methods_of_conf_and_of_a_users_folder(tmp_path):
    (tmp_path / "method").mkdir()
    (tmp_path / "method/mine.yaml").write_text("defaults: [arap]\n")
    known = [path.stem for path in (CONFIGURATION / "method").glob("f*.yaml")]
    sweep = ["experiment=quick", "subject=0", "pose=1,2", "method=glob([f*,mi*],exclude=[fast])"]
    assert prepared(["-m", "--config-dir", str(tmp_path), *sweep]).overrides[-1] == f"run.of={2 * len(known)}"
