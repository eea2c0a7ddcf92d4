"""How Numba is led from Python to machine code: passes, libraries, and questions asked once."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import register_pass
from numba.core.targetconfig import ConfigStack
from numba.core.typed_passes import InlineOverloads, NativeLowering, NopythonRewrites
from numba.core.types.containers import BaseTuple
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables


@contextmanager
def in_one_go(dispatcher: Any) -> Iterator[None]:
    """What makes compiling cheaper: no search for garbage, and no question asked twice.

    Numba tries dozens of rules for each sum of two numbers, and each time it meets one.
    """
    context, known, texts = dispatcher.typingctx, dict[Any, Any](), dict[int, tuple[Any, str]]()

    def options() -> str:
        """Those of the function that is being compiled, which functions of Numba are made for."""
        top = ConfigStack.top_or_none()
        if id(top) not in texts:
            texts[id(top)] = top, repr(top and top.values())
        return texts[id(top)][1]

    def resolve(function: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        own = type(context).resolve_function_type
        if kws or isinstance(function, (types.Dispatcher, types.BoundFunction)):
            return own(context, function, args, kws)
        try:
            return known[key := (function, args, options())]
        except TypeError:  # slices that are constants have no hash
            return own(context, function, args, kws)
        except KeyError:
            found = known[key] = own(context, function, args, kws)
            return found

    with global_compiler_lock:
        collecting, before = gc.isenabled(), vars(context).get("resolve_function_type")
        gc.disable()
        context.resolve_function_type = resolve
        try:
            yield
        finally:
            if before is None:
                del context.resolve_function_type
            else:
                context.resolve_function_type = before
            if collecting:
                gc.enable()


def writable(kind: Any) -> Any:
    """The type of an argument as if all arrays in it could be written: one kernel does for both."""
    if isinstance(kind, types.Array) and not kind.mutable:
        return kind.copy(readonly=False)
    if isinstance(kind, BaseTuple):
        own = getattr(kind, "instance_class", tuple)
        return BaseTuple.from_types(list(map(writable, kind.types)), own)
    return kind


class _Source(JITCodeLibrary):  # type: ignore[misc]
    """Code that kernels hold: it is optimised as part of them, once, and never runs by itself."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _LoweringOfParts(NativeLowering):  # type: ignore[misc]
    """Lowering of what only kernels call: no machine code yet, nor a door for Python."""

    _name = "lowering_of_parts"

    def run_pass(self, state: Any) -> bool:
        context, flags = state.targetctx, state.flags
        state.library = _Source(context.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        super().run_pass(state)
        # by this callers know it; Python, which cannot call it, would get an error
        unique: list[Any] = []
        lowered, name = state["cr"], unique.index
        context.insert_user_function(name, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=name)
        return True


# passes for what kernels do without: functions in functions, expressions of whole arrays, and
# functions of others that are pasted in
_WITHOUT = (InlineClosureLikes, InlineInlinables, InlineOverloads, NopythonRewrites)


class Kernels(CompilerBase):  # type: ignore[misc]
    """The usual passes, but for those that find nothing to do."""

    lowering: Any = NativeLowering

    def define_pipelines(self) -> list[Any]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [
            (self.lowering, text) if one is NativeLowering else (one, text)
            for one, text in passes.passes
            if one not in _WITHOUT
        ]
        passes.finalize()
        return [passes]


class Parts(Kernels):
    """The passes for what kernels call."""

    lowering = _LoweringOfParts
