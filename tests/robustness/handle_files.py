"""Cases: handle files of Implicit-ARAP, and parameters; the corpus has the JSON files."""

from tests.robustness.case import Case, nothing, refused
from tests.robustness.inputs import Given, both, data, garbage, text

DEFORM = "sshade deform body.ply pose.json -o out.ply"
YAML = "sshade deform body.ply pose.yaml -o out.ply"


#: Other commands, with the sound files or another suffix.
CALLS = {
    "a missing file": (DEFORM.replace("pose", "nowhere"), nothing, "nowhere.json: no such file"),
    "an unknown suffix": (DEFORM.replace("json", "txt"), garbage("pose.txt"), "'.txt'"),
    "more handles than proxy vertices": (f"{DEFORM} --vertices 10", nothing, "cannot hold"),
}


def _parts(content: str, *, foot: str = "") -> Given:
    """A configuration of Implicit-ARAP with one part, `foot`."""
    return both(text("parts/foot.txt", foot), text("pose.yaml", f"handles: {{{content}}}\n"))


def _static(part: str) -> str:
    return f"static: {{positions: [{part}]}}"


IMPLICIT_ARAP = {
    "binary garbage": (garbage("pose.yaml"), "not readable as YAML"),
    "no mapping": (text("pose.yaml", "- 1\n- 2\n"), "`handles`"),
    "brackets 10,000 deep": (data("pose.yaml", b"[" * 10_000), "not readable as YAML"),
    "a Python object": (
        text("pose.yaml", "handles: !!python/object/apply:os.system ['touch hacked']\n"),
        "not readable as YAML",
    ),
    "a misspelt key": (_parts("static: {position: [foot]}"), 'did you mean "positions"?'),
    "no parts": (_parts("static: {}, moving: {}"), "there are no handles"),
    "parts that are no names": (_parts("static: {positions: 3}"), "list of names"),
    "a missing part": (_parts(_static("hand")), "hand.txt"),
    "a part outside of its folder": (
        both(text("secret.txt", '"password"'), _parts(_static("../secret"))),
        "'../secret' leads out of",
    ),
    "a part by its absolute path": (_parts(_static("/etc/passwd")), "leads out of"),
    "moving parts without transforms": (
        _parts("moving: {positions: [hand]}"),
        "1 moving parts have 0 transforms",
    ),
    "a part that is no table of numbers": (_parts(_static("foot"), foot="a b c\n"), "three numbers"),
    "parts of another mesh": (
        _parts(_static("foot"), foot="0.1 5 5\n0.2 5 5\n0.1 6 5\n0.4 7 5\n"),
        "is this the mesh they were made for?",
    ),
}


CASES = [
    *(Case(f"handles: {name}", call, g, says=(word,)) for name, (call, g, word) in CALLS.items()),
    *refused(YAML, IMPLICIT_ARAP, prefix="handles: YAML: "),
    Case("deform --seed -1", f"{DEFORM} --seed -1", says=("seed must be a whole number in [0, inf)",)),
]
