"""Every option of the methods once: its type, unit, default, range, and effect.

Validation, ``--help``, the reference page and the columns of result rows are all made from :class:`Options`.
:data:`PRESETS` has the values for each method.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from inspect import cleandoc
from math import inf
from numbers import Real
from typing import Any, Literal, NamedTuple, TypedDict, TypeVar

import numpy as np

from sshade.core.errors import InputError, meant

Elements = Literal["spokes", "spokes_and_rims"]
Start = Literal["rest", "rigid"]
FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def _option(default: Any, values: str, methods: str = "paper fast fine") -> Any:
    """Declare an option with its default, its interval or possible names, and the methods that take it."""
    return field(default=default, metadata={"values": values, "methods": tuple(methods.split())})


@dataclass(frozen=True)
class Stop:
    """When an iteration stops.

    Attributes
    ----------
    tolerance : float
        Residual below which it stops; 0 never stops early. The residual is the largest move of a vertex in
        one plain iteration, as a fraction of the bounding-box diagonal.
    max_iterations : int
    least_iterations : int
        Convergence counts from this iteration on.

    Raises
    ------
    InputError
        When the tolerance or the number of iterations is negative, or no number.
    """

    tolerance: float = 1e-5
    max_iterations: int = 1000
    least_iterations: int = 0

    def __post_init__(self) -> None:
        tolerance, most = self.tolerance, self.max_iterations
        if not (tolerance >= 0 and most >= 0 and most % 1 == 0):
            raise InputError(
                "tolerance must be at least 0 and max_iterations a whole number of at least 0, not "
                f"{tolerance} and {most}"
            )


@dataclass(frozen=True)
class Options:
    """The options of a method. By default: the paper's settings with the published energy.

    None stands for the method's own value wherever options are passed.

    Attributes
    ----------
    vertices : int
        Number of vertices of the proxy, at most a quarter of the mesh's (see `coarser`). Thin parts may add
        some. Raise it where the proxy is too coarse for thin parts; time grows with it.
    coarser : int
        Smallest ratio of the mesh's number of vertices to the proxy's. Lower it to 1 or 2 for a detailed
        proxy of a small mesh.
    samplings : int
        Number of proxies whose results are averaged. A larger number smooths the traces of triangle frames;
        blended frames need one proxy.
    frames : str or FrameMaker
        Local frames that prolong the proxy's deformation to the mesh: rigid frames of its triangles as in
        the paper, or frames at its vertices blended over each triangle.
    workers : int, optional
        Number of threads; by default two for each CPU for samplings, one for each CPU for a single proxy and
        the polish. Results do not depend on it.
    seed : int
        Seed of the sampling. Change it to see how much a result depends on the sampling.
    volume : float
        Weight of the enclosed volume: 0 leaves it unconstrained, inf keeps it exactly. Lower it where the
        shape may shrink or grow. A mesh with a boundary has no volume.
    volume_goal : float, optional
        Volume of the result, as a multiple of the volume at rest; by default it stays. Raise it for a body
        that breathes in. Each component with handles has the same ratio, and must be closed. With a goal, the
        default of `area` is at most 0.1.
    area : float
        Weight of the surface area: 0 leaves it unconstrained, inf keeps it exactly on each proxy; the mean of
        several samplings has less. Lower it where large handle regions move apart.
    stiffness : float
        Fraction of a triangle's stiffness that remains at large strain. Smaller values concentrate bending at
        joints; 1 is the published energy.
    strain : float
        Strain around which triangles soften, without unit. Smaller values make joints sharper. It has no
        effect at a stiffness of 1.
    strain_limit : float
        Strain around which softened triangles become stiff again; inf for never. Lower it if joints crease.
    attachment : float
        Weight with which each group of handles pulls the surface around it towards the rigid motion of the
        group. Raise it if a head or hand tips around its handles; 0 turns it off.
    bending : float
        Length over which a fold is spread, as a fraction of the square root of the area. Raise it if the
        surface creases beside handle regions; 0 turns it off.
    thickness : float
        Weight with which opposite points of a wall or a limb keep their distance. Raise it, first to 1, if
        the walls of a vessel swell or limbs pinch where they bend; 0 turns it off.
    joints : float
        Weight of the thickness in a second solve, which holds the parts that hardly strain and makes the
        joints between them round; 0 turns it off. Lower it if joints should stay sharper.
    tolerance : float
        Residual at which iteration stops: the largest move of a vertex in one plain iteration, as a fraction
        of the bounding-box diagonal. Proxies of ``fast`` and ``fine`` stop at three times this value, because
        their steps are longer. Lower it for a more exact minimum; 0 never stops early.
    max_iterations : int
        Largest number of iterations on each proxy. Lower it to bound the time.
    start : str
        Shape in which the iteration begins: the rest shape as in the paper, or its best rigid motion to the
        handles. `rigid` is faster, and safer where handles turn far. Without `accelerate`, the default is
        `rest`.
    guide_attachment : float
        Weight of the attachment in the guide energy, which is minimised first to choose a local minimum; 0
        turns the guide off. It is off by default where the proxy has no attachment.
    proxy_method : Method, optional
        Method that deforms the proxy in place of our solver. The options of energy and iteration are then
        that method's own.
    accelerate : bool
        Reach the minimum of the proxy in a fraction of the iterations, by quasi-Newton steps. Turn it off for
        the plain iterations of the paper, to compare with them.
    detail : float
        Position between the smooth shape of `fast`, at 0, and the least stretch with the sharpest creases, at
        1. Lower it to come nearer to true poses or to soften creases. It chooses `attachment`,
        `proxy_attachment`, `bending` and `strain_limit`, unless they have values of their own.
    proxy_attachment : float
        Weight of the attachment on the proxy; `attachment` applies to the polish alone, and only where
        `joints` is 0.
    proxy_bending : float
        Length over which a fold is spread on the proxy; `bending` applies to the polish alone.
    proxy_stiffness : float
        Fraction of stiffness at large strain on the proxy; `stiffness` applies to the polish alone.
    polish_iterations : int
        Largest number of iterations at full resolution. A larger number removes more traces of the proxy.
        Where joints turn far, a finite `strain_limit` keeps the polish from converging.
    multilevel, polish : bool
        Fixed for each method: a proxy solve initialised on a coarser proxy, and a second solve at full
        resolution.

    Notes
    -----
    `method` is the name of the method whose options these are, and `given` has the names of the options that
    the user gave. They are no options.
    """

    vertices: int = _option(6000, "[1, inf)")
    coarser: int = _option(4, "[1, inf)")
    samplings: int = _option(5, "[1, inf)", "paper fast")
    frames: Any = _option("triangle", "triangle blended", "paper fast")
    workers: int | None = _option(None, "[1, inf)")
    seed: int = _option(0, "[0, inf)")
    volume: float = _option(0.0, "[0, inf]")
    volume_goal: float | None = _option(None, "(0, 10]")
    area: float = _option(0.0, "[0, inf]")
    stiffness: float = _option(1.0, "(0, 1]")
    strain: float = _option(0.02, "(0, inf)")
    strain_limit: float = _option(inf, "(0, inf]")
    attachment: float = _option(0.0, "[0, inf)")
    bending: float = _option(0.0, "[0, inf)")
    thickness: float = _option(0.0, "[0, inf)")
    joints: float = _option(0.0, "[0, inf)", "fast fine")
    tolerance: float = _option(1e-5, "[0, inf)")
    max_iterations: int = _option(1000, "[0, inf)")
    start: Start = _option("rest", "rest rigid")
    guide_attachment: float = _option(0.0, "[0, inf)", "fast fine")
    proxy_method: Callable[..., Any] | None = _option(None, "", "paper")
    accelerate: bool = _option(True, "", "paper")
    detail: float = _option(0.5, "[0, 1]", "fine")
    proxy_attachment: float = _option(0.0, "[0, inf)", "fine")
    proxy_bending: float = _option(0.0, "[0, inf)", "fine")
    proxy_stiffness: float = _option(1.0, "(0, 1]", "fine")
    polish_iterations: int = _option(0, "[0, inf)", "fine")
    multilevel: bool = _option(False, "", "")
    polish: bool = _option(False, "", "")
    method: str = "paper"
    given: frozenset[str] = field(default=frozenset(), compare=False)

    @property
    def yields(self) -> bool:
        """Whether exact constraints have a largest pressure: without a goal, where triangles soften."""
        return self.volume_goal is None and self.stiffness < 1.0

    @property
    def stop(self) -> Stop:
        """When a solve stops."""
        return Stop(self.tolerance, self.max_iterations)

    def with_regions(self) -> Options:
        """Return the options for handles that are regions: :data:`REGIONS`, unless the user gave others."""
        own = REGIONS.get(self.method, {})
        return replace(self, **{name: value for name, value in own.items() if name not in self.given})

    def of_proxy(self) -> Options:
        """Return the options of the proxy solve, which in ``fine`` differ from the options of the polish."""
        if not self.polish:
            return self
        return replace(
            self,
            attachment=self.proxy_attachment,
            stiffness=self.proxy_stiffness,
            bending=self.proxy_bending,
            strain_limit=inf,
            polish=False,
        )


class OptionValues(TypedDict, total=False):
    """The options of :class:`Options` as keywords of the public functions; None stands for the default."""

    vertices: int | None
    coarser: int | None
    samplings: int | None
    frames: Any
    workers: int | None
    seed: int | None
    volume: float | None
    volume_goal: float | None
    area: float | None
    stiffness: float | None
    strain: float | None
    strain_limit: float | None
    attachment: float | None
    bending: float | None
    thickness: float | None
    joints: float | None
    tolerance: float | None
    max_iterations: int | None
    start: Start | None
    guide_attachment: float | None
    proxy_method: Callable[..., Any] | None
    accelerate: bool | None
    detail: float | None
    proxy_attachment: float | None
    proxy_bending: float | None
    proxy_stiffness: float | None
    polish_iterations: int | None


#: Options of the energy that may change without a new factorisation, and options that change the matrix, as
#: ``attachment`` does through the handles.
ENERGY = ("volume", "area", "stiffness", "strain", "strain_limit")
MATRIX = ("bending", "thickness")
#: Options by the headings of the reference.
GROUPS: Mapping[str, tuple[str, ...]] = {
    "Proxy": ("vertices", "coarser", "samplings", "frames", "workers", "seed"),
    "Energy": ("volume", "volume_goal", *ENERGY[1:], "attachment", *MATRIX, "joints"),
    "Iteration": ("tolerance", "max_iterations", "start", "guide_attachment"),
    "Paper": ("proxy_method", "accelerate"),
    "Polish": ("detail", "proxy_attachment", "proxy_bending", "proxy_stiffness", "polish_iterations"),
}
#: What to do instead where an option has a value out of its range.
HINTS = {"volume_goal": "; it is a ratio, such as 1.1 for 110 %"}
#: Options of functions that sample proxies.
PROXIES = GROUPS["Proxy"]
#: Number of samplings of a transfer by default, as in the paper.
TRANSFER_SAMPLINGS = 10
#: Options for where an iteration starts and when it stops.
ITERATION = ("tolerance", "max_iterations", "start")
#: Options of the solver (:mod:`sshade.solver.local_global`).
SOLVER = (*ENERGY, "attachment", *MATRIX, *ITERATION)

_FAST = Options(
    vertices=12_000,
    samplings=1,
    frames="blended",
    volume=inf,
    area=inf,
    stiffness=0.06,
    strain=0.0125,
    attachment=0.1,
    start="rigid",
    guide_attachment=3.0,
    multilevel=True,
    joints=1.0,
    method="fast",
)
#: Values that `detail` chooses at 0, 1/4, 1/2, 3/4 and 1, with lines between them. A strong attachment on the
#: proxy finds local minima nearer to the ground truth; a weak one in the polish stretches less. Fine
#: triangles can crease, and proxies cannot: hence the bending, and the strain limit, here as 1 / strain.
_ALONG_DETAIL = {
    "proxy_attachment": (0.3, 0.3, 0.3, 0.05, 0.0),
    "attachment": (0.1, 0.03, 0.01, 0.01, 0.0),
    "bending": (0.004, 0.003, 0.003, 0.001, 0.0),
    "strain_limit": (4.0, 4.0, 4.0, 4.0, 0.0),
}


def _at_detail(detail: float) -> dict[str, Any]:
    """Return the values that `detail` chooses."""
    knots = np.linspace(0.0, 1.0, 5)
    found = {name: float(np.interp(detail, knots, values)) for name, values in _ALONG_DETAIL.items()}
    limit = found["strain_limit"]
    return {**found, "strain_limit": 1.0 / limit if limit > 0 else inf}


# An area weight of 1 leaves an error of a third of a percent, and changes edges and angles less than inf.
_FINE = replace(
    _FAST,
    area=1.0,
    stiffness=0.03,
    proxy_stiffness=0.06,
    polish_iterations=50,
    polish=True,
    method="fine",
    **_at_detail(Options.detail),
)
#: The methods.
PRESETS: Mapping[str, Options] = {
    "paper": Options(start="rigid"),
    "fast": _FAST,
    "fine": _FINE,
    "interpolate": Options(method="interpolate"),  # takes no option
}
# Strain and folds gather at the edges of handle regions. A region that moves away stretches the surface
# between regions; with an exact area the rest of the surface would pay for it. More attachment on the proxy
# brings bodies nearer to the ground truth, and stretches other shapes no more.
_REGIONS: Mapping[str, Any] = {"area": 0.1, "stiffness": 0.08}
#: Differences of the methods where handles are regions.
REGIONS: Mapping[str, Mapping[str, Any]] = {
    "fast": {**_REGIONS, "bending": 0.003},
    "fine": {**_REGIONS, "proxy_bending": 0.003},
}


class Option(NamedTuple):
    """The meaning of an option, its valid values, and the methods that take it.

    Attributes
    ----------
    kind : str
        Type: "int", "float", "bool" or any.
    interval, choices : str, tuple of str
        Valid numbers or names.
    methods : tuple of str
    effect : str
    """

    kind: str
    interval: str
    choices: tuple[str, ...]
    methods: tuple[str, ...]
    effect: str

    @property
    def values(self) -> str:
        """The valid values, in words."""
        if self.choices:
            return f"{', '.join(self.choices[:-1])} or {self.choices[-1]}"
        if not self.interval:
            return "true or false" if self.kind == "bool" else "a function"
        number = "a whole number" if self.kind == "int" else "a number"
        low, high = self.interval[1:-1].split(", ")
        open_low, open_high = self.interval[0] == "(", self.interval[-1] == ")"
        if open_high:  # the ends that are left out are infinite
            return f"{number} above {low}" if open_low else f"{number} of at least {low}"
        return f"{number} above {low} and up to {high}" if open_low else f"{number} from {low} to {high}"

    def checked(self, name: str, value: Any) -> Any:
        """Return a valid value with Python's own type of number, and raise InputError on any other."""
        if self.kind == "bool":
            valid = isinstance(value, bool)
        elif self.interval:
            valid = isinstance(value, Real) and not isinstance(value, bool) and self._holds(float(value))
            value = (int if self.kind == "int" else float)(value) if valid else value
        else:
            takes_objects = self.kind != "Start" and (bool(self.choices) or callable(value))
            valid = value in self.choices if isinstance(value, str) else takes_objects
        if not valid:
            hint = meant(value, self.choices) or HINTS.get(name, "")
            raise InputError(f"{name} must be {self.values}, not {value!r}{hint}")
        return value

    def _holds(self, value: float) -> bool:
        low, high = (float(end) for end in self.interval[1:-1].split(","))
        above = value > low if self.interval[0] == "(" else value >= low
        below = value < high if self.interval[-1] == ")" else value <= high
        return above and below and (self.kind == "float" or value.is_integer())


@cache
def described() -> Mapping[str, Option]:
    """Return each option by name, with the effect from the docstring of :class:`Options`."""
    attributes = re.findall(r"^(\w+) : .*((?:\n    .+)+)", cleandoc(Options.__doc__ or ""), re.MULTILINE)
    effects = {name: " ".join(text.split()) for name, text in attributes}
    found = {}
    for entry in (one for one in fields(Options) if one.metadata):
        values, interval = entry.metadata["values"], entry.metadata["values"][:1] in ("[", "(")
        kind, choices = str(entry.type).split(" ")[0], () if interval else tuple(values.split())
        methods, effect = entry.metadata["methods"], effects.get(entry.name, "")
        found[entry.name] = Option(kind, values if interval else "", choices, methods, effect)
    return found


def require_method(name: str, methods: Collection[str] = tuple(PRESETS)) -> str:
    """Return the name of a method, and raise InputError on a name outside `methods`."""
    if name in methods:
        return name
    hint = meant(name, methods) or f"; use {', '.join(map(repr, methods))}"
    raise InputError(f"there is no method {name!r} here{hint}")


def accepted(method: str) -> tuple[str, ...]:
    """Return the names of the options that a method takes."""
    require_method(method)
    return tuple(name for name, option in described().items() if method in option.methods)


def checked(values: Mapping[str, Any], names: Collection[str], *, subject: str) -> dict[str, Any]:
    """Check names and values of options.

    Parameters
    ----------
    values : mapping
        None stands for the default.
    names : collection of str
        Options that are taken.
    subject : str
        Method or function that takes them, for errors.

    Returns
    -------
    dict
        The values that are not None.

    Raises
    ------
    InputError
        On an unknown name, with the nearest right one, or a value out of its range.
    """
    about = described()
    for name, value in values.items():
        if name in names or (name in about and value is None):
            continue
        if name in about:
            takes = about[name].methods if subject.startswith("the method ") else ()
            action = f"it needs --method {' or '.join(takes)}" if takes else "leave it out"
            raise InputError(f"{subject} has no use for the option {name!r}; {action}")
        hint = meant(name, names) or f"; the options are {', '.join(names)}"
        raise InputError(f"{subject} has no option {name!r}{hint}")
    return {name: about[name].checked(name, value) for name, value in values.items() if value is not None}


def resolve(method: str, values: Mapping[str, Any]) -> Options:
    """Return the options of a method.

    Parameters
    ----------
    method : str
        A key of :data:`PRESETS`.
    values : mapping
        Options by name; None stands for the method's own value.

    Raises
    ------
    InputError
        On an unknown method, and as :func:`checked`.
    """
    values = checked(values, accepted(method), subject=f"the method {method!r}")
    given = frozenset(values)
    if "detail" in values:
        values = {**_at_detail(values["detail"]), **values}
    options = replace(PRESETS[method], given=given, **values)
    if not options.accelerate and "start" not in values:
        options = replace(options, start="rest")  # as published
    if options.volume_goal is not None and options.volume == 0:
        raise InputError("volume_goal needs a weight of the volume, which is 0 here; give volume=inf")
    if options.volume_goal is not None and options.proxy_method is not None:
        raise InputError("volume_goal needs our solver; leave `proxy_method` out")
    if options.of_proxy().attachment == 0 and "guide_attachment" not in values:
        options = replace(options, guide_attachment=0.0)
    return options


def as_row(options: Options) -> dict[str, Any]:
    """Return the options of a method as a flat mapping of plain values, for rows of results."""
    values = {name: getattr(options, name) for name in accepted(options.method)}
    if options.proxy_method is not None:
        values = {name: value for name, value in values.items() if name not in (*SOLVER, "accelerate")}
    plain = (bool, int, float, str, type(None))
    return {name: value for name, value in values.items() if isinstance(value, plain)}


def takes_options(
    names: Collection[str] | Callable[[Mapping[str, Any]], Collection[str]], *, task: Any = None
) -> Any:
    """Decorate a function with `option_names`: the options that its ``**options`` may hold.

    Parameters
    ----------
    names : collection of str, or callable
        A callable computes the names from the other parameters.
    task : type, optional
        Kind of task that the function takes, where its signature does not say so.
    """

    def decorated(function: FunctionT) -> FunctionT:
        function.option_names, function.task_kind = names, task  # type: ignore[attr-defined]
        return function

    return decorated


def _in_words(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def default(name: str, presets: Mapping[str, Options | Mapping[str, Any]] = PRESETS) -> str:
    """Return an option's value in each preset, in words; one word where all methods have it and agree."""
    found: dict[str, list[str]] = {}
    for method in described()[name].methods:
        preset = presets.get(method, {})
        values = preset if isinstance(preset, Mapping) else vars(preset)
        if name in values:
            value = values[name]
            found.setdefault(_in_words(value), []).append(method)
    if presets is PRESETS and list(map(len, found.values())) == [len(described()["seed"].methods)]:
        return next(iter(found))
    return "; ".join(f"{text} ({', '.join(methods)})" for text, methods in found.items())


def help_text(name: str, value: Any = None) -> str:
    """Return the line of ``--help`` for an option, whose default may be another `value`."""
    option = described()[name]
    usual = default(name) if value is None else value
    return f"{option.effect} Values: {option.values}. Default: {usual}."
