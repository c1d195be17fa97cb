"""Fuzz a target with atheris: ``python -m tests.fuzz.guided TARGET CORPUS SCRATCH [options]``."""

import sys
from pathlib import Path

import atheris

#: Packages that count coverage: our packages, and the parsers that they call.
PACKAGES = ("sshade", "defaust", "eval")
PARSERS = ["json", "yaml"]
ROOT = Path(__file__).parents[2]
#: Modules with kernels do not count coverage, because a kernel that counts cannot be compiled.
COMPILED = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for package in PACKAGES
    for path in (ROOT / package).rglob("*.py")
    if "@kernel" in path.read_text(encoding="utf-8")
]

with atheris.instrument_imports(include=[*PACKAGES, *PARSERS], exclude=COMPILED):
    import json  # noqa: F401

    import yaml  # noqa: F401

    from tests.fuzz.targets import TARGETS, refused_or_read


def main() -> None:
    """Write the seeds and the dictionary, then fuzz. LibFuzzer ends the process and removes no files."""
    name, corpus, scratch, *options = sys.argv[1:]
    target = TARGETS[name]
    for number, seed in enumerate(target.seeds()):
        Path(corpus, f"seed_{number}").write_bytes(seed)
    words, folder = Path(scratch, "words"), Path(scratch, "input")
    folder.mkdir()
    words.write_text("".join('"' + "".join(f"\\x{b:02x}" for b in token) + '"\n' for token in target.tokens))

    def one_input(data: bytes) -> None:
        refused_or_read(target, data, folder)

    atheris.Setup([sys.argv[0], *options, f"-dict={words}", corpus], one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
