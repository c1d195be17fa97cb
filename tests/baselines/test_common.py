"""Promises of several baselines: rigid motions, collapsed faces, components, soft handles, wrong options."""

from dataclasses import replace
from functools import partial
from inspect import signature

import numpy as np
import pytest

from baselines.ablations.replaced import paper_with
from baselines.accelerated import accelerated_arap, accelerated_elastic, local_global
from baselines.arap import arap, elastic, libigl_arap
from baselines.arap_sr.arap_sr import arap_sr
from baselines.deformation_fields import deformation_field
from baselines.deformation_graph.deformation_graph import deformation_graph
from baselines.identity import identity
from baselines.implicit_arap import implicit_arap
from baselines.rbf import rbf
from baselines.smooth_arap import smooth_arap
from baselines.volumetric.lattice_arap import lattice_arap
from baselines.volumetric.neo_hookean import neo_hookean
from baselines.volumetric.skinning import bounded_biharmonic_weights
from sshade import DeformationTask, Handles, InputError, Mesh
from tests.shapes import bent, beside, bumpy, held_ends, icosphere, rotation
from tests.sshade.method.test_deform import check_collapsed

ROUNDING = 1e-9
#: libigl fits rotations in single precision.
SINGLE = 1e-5
RIGID = [(libigl_arap, {}, SINGLE), *((method, {}, ROUNDING) for method in (arap_sr, smooth_arap))]
RIGID += [(deformation_field, {"order": order}, ROUNDING) for order in (1, 2)]
RIGID += [(deformation_graph, {"nodes": 30}, ROUNDING)]
#: Other refusals stand in a transcript.
WRONG = [
    (implicit_arap, {"sdf": "gird"}, "sdf='gird' is unknown; use 'network' or 'grid'"),
    (implicit_arap, {"sdf_layers": 1}, "use at least two layers and three points"),
    (implicit_arap, {"weights": "cotan"}, "weights='cotan' is unknown; use 'cotangents' or 'authors'"),
    (neo_hookean, {"poisson": 0.5}, "poisson"),
    (neo_hookean, {"load_steps": 0}, "poisson"),
    (bounded_biharmonic_weights, {"qp_iterations": 0}, "active set"),
]
#: A value other than the default for each parameter, without switches.
OTHER = {"energy": "spokes", "tolerance": 1e-2, "max_iterations": 2, "start": "rigid", "alpha": 0.2}
OTHER |= {"nodes": 30, "blended": 2, "order": 2, "smoothness": 0.5}
OTHER |= {"cells": 10, "handle_weight": 1.0, "neighbours": 9, "kernel": "cubic"}
#: Parameters that change no result.
SAME = {"task", "seed", "progress", "options", "factorised"}
ITERATED = [arap_sr, deformation_graph, smooth_arap]
GUESSED = [arap, elastic, accelerated_arap, partial(accelerated_elastic, volume=1.0), *ITERATED, paper_with]
OPTED = [libigl_arap, *ITERATED, deformation_field, lattice_arap, rbf]


def called(method, task, **options):
    try:
        return method(task, **options)
    except ImportError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize(("method", "options", "close"), RIGID)
def test_a_rigid_start_of_rigidly_moved_handles_is_the_answer(method, options, close):
    mesh = bumpy(2)
    expected = mesh.V @ rotation(3).T + [1.0, -2, 0.5]
    index = np.argsort(mesh.V[:, 2])[[0, 1, 2, 3, -3, -2, -1]]
    task = DeformationTask("rigid", mesh, Handles(index, expected[index]))
    result = called(method, task, start="rigid", **options)
    assert np.abs(result.vertices - expected).max() < close * mesh.diagonal
    assert result.iterations == 1 and result.converged is not False


@pytest.mark.parametrize("method", [*OPTED, accelerated_arap, accelerated_elastic, local_global])
def test_every_parameter_counts(method):
    # Also one that is new.
    task, given = held_ends(bumpy(2)), signature(method).parameters
    other = OTHER | {n: not p.default for n, p in given.items() if isinstance(p.default, bool)}
    fixed = {"cells": 16} if "cells" in given else {}
    plain = method(task, **fixed).vertices
    for name in given.keys() - SAME:
        assert not np.array_equal(plain, method(task, **fixed | {name: other[name]}).vertices), name


@pytest.mark.parametrize("method", GUESSED)
def test_a_guess_counts_and_progress_is_told(method):
    told, task = [], held_ends(bumpy(2))
    options = {"max_iterations": 1, "progress": lambda *words: told.append(words)}
    found = [method(one, **options).vertices for one in (task, replace(task, guess=bent(task.mesh.V)))]
    assert told and not np.array_equal(*found)


@pytest.mark.parametrize(("method", "options", "message"), WRONG)
def test_options_out_of_range_are_refused(method, options, message):
    with pytest.raises(InputError, match=message):
        called(method, held_ends(bumpy(1)), **options)


@pytest.mark.parametrize("method", [accelerated_arap, accelerated_elastic, *ITERATED])
def test_collapsed_faces_are_deformed_as_those_around_them(method):
    flat, count = check_collapsed(method)
    assert flat.converged and count >= 6


@pytest.mark.parametrize("method", [arap, *ITERATED, deformation_field])
def test_a_component_without_a_handle_is_refused(method):
    task, other = held_ends(bumpy(1)), icosphere(1)
    both = beside(task.mesh, Mesh(other.V + 5, other.F))
    with pytest.raises(InputError, match="1 of the mesh's 2 components has no handle"):
        method(DeformationTask("two", both, task.handles))


@pytest.mark.parametrize("method", [arap, elastic, deformation_field])
def test_a_triangle_without_area_is_refused(method):
    task = held_ends(bumpy(1))
    V = np.array(task.mesh.V)
    V[task.mesh.F[0, 2]] = V[task.mesh.F[0, :2]].mean(axis=0)
    with pytest.raises(InputError, match="1 triangle of the rest mesh has no area"):
        method(DeformationTask("flat", Mesh(V, task.mesh.F), task.handles))


UNUSED = {"soft handles": {"weight": np.repeat([np.inf, 1.0], [8, 1])}}
UNUSED["rotations"] = {"rotation": np.where(np.arange(9)[:, None, None] == 8, np.eye(3), np.nan)}
NEAREST = partial(paper_with, handle_mode="nearest")


@pytest.mark.parametrize(
    "method", dict.fromkeys([arap, identity, NEAREST, *OPTED, *(one for one, *_ in WRONG)])
)
@pytest.mark.parametrize(("words", "more"), UNUSED.items())
def test_one_soft_handle_or_rotation_is_refused(method, words, more):
    task = held_ends(bumpy(1))
    with pytest.raises(InputError, match=f"takes no {words}"):
        called(method, replace(task, handles=replace(task.handles, **more)))
