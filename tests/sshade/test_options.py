from sshade.problem import options as module
from sshade.problem.options import GROUPS, PRESETS, accepted, described


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
