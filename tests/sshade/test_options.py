from dataclasses import replace
from math import inf

import numpy as np
import pytest

from sshade import InputError
from sshade.problem import options as module
from sshade.problem.options import GROUPS, PRESETS, REGIONS, accepted, described, resolve


def test_detail_chooses_the_values_of_the_polish_from_smooth_to_least_stretch():
    chosen = ("attachment", "proxy_attachment", "bending", "strain_limit")
    assert resolve("fine", {"detail": PRESETS["fine"].detail}) == PRESETS["fine"]
    along = [resolve("fine", {"detail": detail}) for detail in np.linspace(0, 1, 9)]
    for name in chosen:
        values = [getattr(options, name) for options in along]
        assert values == sorted(values, reverse=name != "strain_limit") and values[0] != values[-1]
        assert getattr(resolve("fine", {"detail": 0.1, name: 0.07}), name) == 0.07
    others = [replace(options, detail=0, **dict.fromkeys(chosen, 1.0)) for options in along[:-1]]
    assert all(other == others[0] for other in others)
    assert resolve("fine", {"detail": 0.0}).with_regions().proxy_bending == REGIONS["fine"]["proxy_bending"]
    assert along[0].strain_limit < along[0].of_proxy().strain_limit == inf
    with pytest.raises(InputError, match="detail must be a number from 0 to 1"):
        resolve("fine", {"detail": 1.5})


def test_each_option_is_in_one_group_and_has_an_effect_and_a_help():
    grouped = [name for names in GROUPS.values() for name in names]
    assert sorted(grouped) == sorted({name for method in PRESETS for name in accepted(method)})
    for name in grouped:
        option = described()[name]
        assert len(option.effect.split()) > 5 and option.effect in module.help_text(name)
    for method in PRESETS:  # the presets themselves are valid
        for name in accepted(method):
            value = getattr(PRESETS[method], name)
            assert value is None or described()[name].checked(name, value) == value


def test_the_typed_keywords_are_the_options():
    named = {name for name, option in described().items() if option.methods}
    assert set(module.OptionValues.__annotations__) == named
