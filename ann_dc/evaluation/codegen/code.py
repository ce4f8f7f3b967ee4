"""Addresses of compiled functions by the wiring for which they were compiled.

Code is searched in memory, then on disk, and compiled if there is none. The key contains everything
on which the code depends: wiring, processor, compiler, and the modules that wrote the code. LLVM
[1]_ compiles for the current processor, within the process.

References
----------
.. [1] C. Lattner, V. Adve, LLVM: a compilation framework for lifelong program analysis and
   transformation, Int. Symp. on Code Generation and Optimization, 2004, 75-86.
"""

from __future__ import annotations

import hashlib
import re
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from ann_dc import jit_cache as object_cache

_SPEED = 2
"""Optimisation level of LLVM's instruction selection."""


@cache
def _engine() -> tuple[Any, Any]:
    """Return the execution engine and the target machine."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=_SPEED
    )
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), target), target


@cache
def processor() -> str:
    """Return a description of the processor and compiler, on which the code depends."""
    features = llvm.get_host_cpu_features().flatten()
    version = ".".join(map(str, llvm.llvm_version_info))
    return f"{llvm.get_host_cpu_name()} {features} LLVM {version} llvmlite {llvmlite.__version__}"


@cache
def _passes() -> Any:
    """Return the optimisation passes; the standard pipeline doubles the time for 2 %."""
    passes = llvm.create_new_function_pass_manager()
    passes.add_sroa_pass()
    passes.add_new_gvn_pass()
    passes.add_instruction_combine_pass()
    return passes


def _compile_text(text: str, suffix: str) -> bytes:
    """Compile a module to an object file, optimised for the current processor.

    The text is in LLVM's language. The suffix is appended to the function names, so that names are
    unique across objects.
    """
    _, target = _engine()
    for name in re.findall(r"^define \S+ @(\w+)", text, flags=re.M):
        text = text.replace(f"@{name}(", f"@{name}_{suffix}(")
    module = llvm.parse_assembly(text)
    module.triple, module.data_layout = llvm.get_default_triple(), str(target.target_data)
    builder = llvm.create_pass_builder(target, llvm.create_pipeline_tuning_options())
    for function in module.functions:
        if not function.is_declaration:
            _passes().run(function, builder)
    return target.emit_object(module)


def _load_object(content: bytes, names: tuple[str, ...], suffix: str) -> dict[str, int]:
    """Load an object file and return the addresses of its functions.

    The object file stays in memory for the lifetime of the process. The content comes from
    `_compile_text` on the same machine, with the same suffix.
    """
    engine, _ = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    return {name: engine.get_function_address(f"{name}_{suffix}") for name in names}


_loaded: dict[str, dict[str, int]] = {}
_lock = threading.Lock()


@cache
def _written_by(folder: Path) -> bytes:
    """Return the checksum of the modules in a folder."""
    total = hashlib.sha256()
    for module in sorted(folder.glob("*.py")):
        total.update(module.read_bytes())
    return total.digest()


def key_of(identity: tuple, *folders: Path) -> str:
    """Return the key of a piece of code as a hexadecimal string.

    The identity contains plain numbers and words that distinguish the code. The folders contain the
    modules that write the code.
    """
    written = map(_written_by, (*folders, Path(__file__).parent))
    parts = repr(identity).encode(), processor().encode(), *written
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def code(key: str, write: Callable[[], str], names: tuple[str, ...]) -> dict[str, int]:
    """Return the addresses of the named functions of a piece of code.

    ``write`` returns the text of the code, if it must be compiled.
    """
    with _lock:
        if key not in _loaded:
            content = object_cache.load(key)
            if content is None:
                content = _compile_text(write(), key[:16])
                object_cache.store(key, content)
            _loaded[key] = _load_object(content, names, key[:16])
        return _loaded[key]
