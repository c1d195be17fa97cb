"""Calls name their arguments: no call splats a dictionary that the reader has to look for.

Allowed are the function's own ``**keyword`` parameters, and the calls that ALLOWED counts for each file. The
test also fails for a file with fewer calls, so that its number is lowered.
"""

import ast

from tests.test_names import ROOT, SOURCES

ALLOWED = {
    "baselines/accelerated.py": 1,
    "defaust/configuration.py": 1,
    "eval/bench/drags.py": 1,
    "eval/check.py": 1,
    "eval/run/config.py": 1,
    "eval/run/targets.py": 2,
    "sshade/edit/recovery.py": 1,
    "sshade/method/transfer.py": 1,
    "sshade/problem/facts.py": 1,
    "sshade/problem/options.py": 3,
    "sshade/proxy/binding_file.py": 1,
    "sshade/solver/constraints.py": 3,
}


def splats(node, own=frozenset()):
    """Yield each ``**value`` in the calls below `node` that is not one of the parameters `own`."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)) and node.args.kwarg:
        own = own | {node.args.kwarg.arg}
    for keyword in node.keywords if isinstance(node, ast.Call) else ():
        if keyword.arg is None and not (isinstance(keyword.value, ast.Name) and keyword.value.id in own):
            yield keyword.value
    for child in ast.iter_child_nodes(node):
        yield from splats(child, own)


def test_calls_splat_only_parameters_of_their_function():
    names = [path.relative_to(ROOT).as_posix() for path in SOURCES]
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES]
    counts = [sum(1 for _ in splats(tree)) for tree in trees]
    assert {name: count for name, count in zip(names, counts, strict=True) if count} == ALLOWED
