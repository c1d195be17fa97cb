"""Nothing that is read is executed: the packages call no loader that could."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = [
    p for name in ("sshade", "baselines", "defaust", "eval") for p in sorted((ROOT / name).rglob("*.py"))
]

#: Imports and calls that turn bytes into objects or execute text.
DANGERS = re.compile(
    r"^\s*(?:import|from) (?:pickle|cPickle|dill|joblib|marshal|shelve|jsonpickle)\b"
    r"|(?<![\w.])(?:eval|exec|compile|os\.system|os\.popen|runpy\.run_path)\("
    r"|\b(?:yaml\.(?:unsafe_|full_)?load|torch\.load|(?:pandas|pd)\.read_pickle|np\.loads)\("
    r"|extractall\(|\b(?:allow_pickle|shell)=(?!False\b)|\bnp\.load\((?!.*allow_pickle)",
    re.MULTILINE,
)


#: The store of kernels holds machine code, which has the trust of the package that it comes with.
ALLOWED = {str(ROOT / "sshade" / "core" / "kernels.py"): ["import pickle"]}


def test_no_module_executes_what_it_reads():
    assert len(SOURCES) > 60
    found = {str(path): DANGERS.findall(path.read_text(encoding="utf-8")) for path in SOURCES}
    assert {path: what for path, what in found.items() if what} == ALLOWED
