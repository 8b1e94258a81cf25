"""Compiled kernels: none comes stale from the cache, and whoever waits for them is told why."""

import functools
import gc
import glob
import hashlib
import logging
import math
import time
from collections.abc import Callable, Sequence
from multiprocessing import current_process
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

from numba import njit
from numba.core import caching, cgutils, codegen, event, ir, types, untyped_passes
from numba.core.analysis import dead_branch_prune
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.inline_closurecall import InlineWorker
from numba.core.targetconfig import TargetConfig
from numba.core.typed_passes import NativeLowering
from numba.extending import lower_builtin, overload, type_callable
from numba.np import arrayobj

from hcbf_gym.sources import PACKAGE, sources_hash

if TYPE_CHECKING:
    from rich.progress import Progress

Value = TypeVar("Value")
Function = TypeVar("Function", bound=Callable[..., Any])

_LOGGER = logging.getLogger("hcbf_gym")
SELDOM = 50_000, 20, 50
"""How seldom garbage is collected while kernels are compiled: what Numba makes is kept, and looking
through it takes a sixth of the time."""
COMPILING = "compiling kernels, once; later starts read the cache"
SAID_EVERY = 15.0
"""Where no terminal shows the count, it is logged [s]."""


@functools.cache
def prepare() -> None:
    """Make Numba key this package's kernels by all their sources, and announce a compilation.

    Numba keys a cached kernel by the file in which it stands. A kernel holds what it calls in
    other files too, so an edit there would go unseen. Only the key and the files' names change:
    where the cache lies, and whether there is one, stays Numba's and the user's choice. Kernels
    that were cached under other sources are removed.
    """
    _shorten()
    caching.IndexDataCacheFile = CacheFile
    caching.CacheImpl._locator_classes = [
        type(locator.__name__, (_KeyedByAllSources, locator), {})
        for locator in caching.CacheImpl._locator_classes
    ]
    event.register("numba:compile", _Announcer())


def _shorten() -> None:
    """Let Numba do the same with less where it compiles this package's kernels.

    It takes a fifth of the time off. What others compile in this process is compiled as before.
    """
    for owner, name, ours in (
        (TargetConfig, "values", _values),
        (InlineWorker, "inline_function", _inline),
        (untyped_passes, "dead_branch_prune", _prune),
    ):
        setattr(owner, name, ours)


def _is_of_package(module: str | None) -> bool:
    """Return whether a module, None of what has none, is of this package."""
    return (module or "").partition(".")[0] == "hcbf_gym"


def _tell_shapes(tell: bool) -> None:
    """Let an assignment of another size tell both shapes, as Numba does, or not.

    With the shapes in it the error compiles the handling of text, for three seconds.

    Args:
        tell: False while this package's kernels are compiled.
    """
    arrayobj.raise_with_shape_context = _RAISE_SHAPES if tell else _raise_sizes


_RAISE_SHAPES = arrayobj.raise_with_shape_context


def _raise_sizes(source: tuple[int, ...], target: tuple[int, ...]) -> None:
    """Stand for the error in Numba's own words for targets that have no text."""
    raise NotImplementedError


overload(_raise_sizes)(arrayobj.ol_raise_with_shape_context_generic)


def _values(config: TargetConfig) -> dict[str, object]:
    """Return the values of Numba's options, which it compares at every call that it types."""
    return _defaults(type(config)) | config._values


@functools.cache
def _defaults(kind: type[TargetConfig]) -> dict[str, object]:
    return {name: option.default for name, option in kind.options.items()}


class _Fresh(ir.Block):
    """Code that was translated for this one place, so that nobody needs another copy of it."""

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Fresh":
        return self


_inline_a_copy = InlineWorker.inline_function


def _inline(
    worker: Any, caller: Any, block: Any, at: int, function: Any, arg_typs: Any = None
) -> Any:
    """Put a function's code in the place of a call, as Numba does, but not a copy of a copy."""
    if not _is_of_package(function.__module__):
        return _inline_a_copy(worker, caller, block, at, function, arg_typs)
    code = worker.run_untyped_passes(function)
    fresh = list(code.blocks.values())
    for one in fresh:
        one.__class__ = _Fresh
    free = function.__code__.co_freevars
    try:
        return worker.inline_ir(caller, block, at, code, free, arg_typs=arg_typs)
    finally:
        for one in fresh:
            one.__class__ = ir.Block


class _Given(NamedTuple):
    """The type of an argument that is not None; Numba asks literal ones alone whether they are."""

    literal_type: types.Type


def _prune(code: ir.FunctionIR, kinds: Sequence[types.Type]) -> None:
    """Leave out branches that a comparison with None excludes, also where a thing is not None."""
    if _is_of_package(code.func_id.modname):
        maybe = types.NoneType, types.Omitted, types.Optional, types.PyObject
        kinds = [kind if isinstance(kind, maybe) else _Given(kind) for kind in kinds]
    dead_branch_prune(code, kinds)


class Stamp(NamedTuple):
    """What a kernel of this package was compiled from.

    Attributes:
        own: Numba's stamp of its own file.
        sources: hash of all the files that it imports.
    """

    own: Any
    sources: str


class CacheFile(caching.IndexDataCacheFile):
    """The cache of one kernel of this package, for several processes at once.

    Numba numbers the signatures of a kernel, and writes the index before what it tells of. Under
    new sources another process may then find the old kernel under the new index, and run it; and of
    two that compile two signatures at once, one may run the other's. Here a signature's file is
    named by all that it was made from, and stands before the index does.
    """

    def save(self, key: object, data: object) -> None:
        """Keep a signature's kernel; those of other sources go."""
        if not isinstance(self._source_stamp, Stamp):
            super().save(key, data)
            return
        kernel = self._index_name.removesuffix(".nbi")
        digest = hashlib.sha256(self._dump((self._source_stamp, key))).hexdigest()
        name = f"{kernel}.{digest[:16]}.nbc"
        self._save_data(name, data)
        kept = self._load_index() | {key: name}
        self._save_index(kept)
        for file in Path(self._cache_path).glob(f"{glob.escape(kernel)}.*.nbc"):
            if file.name not in kept.values():
                file.unlink(missing_ok=True)


class _KeyedByAllSources:
    """Adds to a cache locator's stamp of a kernel's own file that of the files it imports."""

    _py_file: str

    def get_source_stamp(self) -> object:
        """Return what tells whether the cached kernel is that of the present sources."""
        stamp = super().get_source_stamp()  # type: ignore[misc]
        file = Path(self._py_file)
        return Stamp(stamp, sources_hash([file])) if file.is_relative_to(PACKAGE) else stamp


def kernel(**options: Any) -> Callable[[Function], Function]:
    """Return a decorator that compiles a function as `numba.njit` does, in half the time.

    Numba makes machine code of every function and of all that it calls, so what is called five
    deep is optimised five times. Here what another kernel calls is handed on as it was translated,
    and the kernel that Python calls is optimised once, as a whole. Only that one is cached.

    Args:
        options: as `numba.njit` takes them.
    """
    parts = dict(options, pipeline_class=_PartCompiler)
    parts.update(no_cpython_wrapper=True, no_cfunc_wrapper=True)

    def decorate(function: Function) -> Function:
        whole: Any = njit(cache=True, **options)(function)
        if whole is function:  # the user has switched Numba off
            return function
        part: Any = njit(**parts)(function)
        part.add_overload = functools.partial(_keep, part.overloads)
        whole.get_call_template = functools.partial(_template_of, part)  # what a kernel asks for
        whole.get_overload = part.get_overload
        return whole

    return decorate


def _template_of(part: Any, arguments: Any, named: dict[str, Any]) -> Any:
    """Return what a kernel calls: for every number the same, also where it is written out."""
    kinds = (types.unliteral(kind) for kind in arguments)
    return part.get_call_template(
        tuple(kinds), {name: types.unliteral(kind) for name, kind in named.items()}
    )


def _keep(overloads: dict[Any, Any], compiled: Any) -> None:
    """Keep what was translated for other kernels; Python has no way to call it."""
    overloads[tuple(compiled.signature.args)] = compiled


class _Part(codegen.JITCodeLibrary):
    """What one function was translated to: neither optimised nor machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):
    """Translates a function for those that call it."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> Literal[True]:
        """Leave the code in `state`, by a name of its own."""
        state.library = _Part(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        made = state["cr"]._replace(cfunc=object())
        state.targetctx.insert_user_function(made.cfunc, made.fndesc, [state.library])
        state["cr"] = made
        return True


class _PartCompiler(CompilerBase):
    """Numba's compiler, up to what a caller needs."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes, the last of them ours."""
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [
            (_PartLowering if step is NativeLowering else step, why) for step, why in manager.passes
        ]
        manager.finalize()
        return [manager]


def borrowed(value: Value) -> Value:
    """Return an array, or a tuple with arrays in it, whose references are not counted.

    Wherever Numba hands an array on, it counts a reference by an atomic instruction; in kernels of
    a few hundred operations that takes longer than the rest. Only for a compiled function's own
    arguments: its caller keeps them alive.
    """
    return value


@type_callable(borrowed)
def _type_borrowed(context: Any) -> Callable[[Any], Any]:
    return lambda value: value


@lower_builtin(borrowed, types.Any)
def _lower_borrowed(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return _without_owner(context, builder, signature.args[0], arguments[0])


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return LLVM's value of an array or a tuple without the memory's owner; others as they are."""
    if isinstance(kind, types.BaseTuple):
        kinds: Any = kind
        parts = cgutils.unpack_tuple(builder, value)
        kept = [
            _without_owner(context, builder, one, part)
            for one, part in zip(kinds.types, parts, strict=True)
        ]
        return context.make_tuple(builder, kind, kept)
    if not isinstance(kind, types.Array):
        return value
    array = arrayobj.make_array(kind)(context, builder, value)
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    array.parent = cgutils.get_null_value(array.parent.type)
    return array._getvalue()


class _Announcer(event.Listener):
    """Says that kernels are compiled instead of read from the cache, and how many by now.

    A terminal shows a line that counts; elsewhere, and from workers, the count is logged at times.
    """

    def __init__(self) -> None:
        self._depth = self._count = 0
        self._collects = gc.get_threshold()
        self._line: Progress | None = None
        self._logged = -math.inf

    def on_start(self, event: event.Event) -> None:
        """Begin with the kernel that Python calls; what it calls is compiled meanwhile."""
        if not _is_ours(event):
            return
        self._depth += 1
        if self._depth == 1:
            self._collects = gc.get_threshold()
            gc.set_threshold(*SELDOM)
            _tell_shapes(False)
            self._begin()

    def on_end(self, event: event.Event) -> None:
        """Count."""
        if not _is_ours(event):
            return
        self._depth -= 1
        self._count += 1
        if self._depth == 0:
            gc.set_threshold(*self._collects)
            _tell_shapes(True)
        if self._line is None:
            self._log(f"{COMPILING}: {self._count}")
            return
        self._line.update(self._line.task_ids[0], completed=self._count)
        if self._depth == 0:
            self._line.stop()

    def _begin(self) -> None:
        # only who compiles waits for the import
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        if self._line is not None:
            self._line.start()
            return
        console = Console(stderr=True)
        if console.is_terminal and current_process().name == "MainProcess":
            count = TextColumn(f"{COMPILING}: {{task.completed:.0f}}")
            columns = SpinnerColumn(), count, TimeElapsedColumn()
            self._line = Progress(*columns, console=console, transient=True)
            self._line.add_task("", total=None)
            self._line.start()
        else:
            self._log(COMPILING)

    def _log(self, says: str) -> None:
        """Say something where the last time is long ago."""
        now = time.monotonic()
        if now - self._logged > SAID_EVERY:
            self._logged = now
            _LOGGER.warning(says)


def _is_ours(event: event.Event) -> bool:
    """Return whether a kernel of this package is compiled."""
    assert event.data is not None
    return _is_of_package(event.data["dispatcher"].py_func.__module__)
