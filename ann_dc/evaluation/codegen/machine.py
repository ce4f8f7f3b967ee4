"""Compilation by LLVM for the current processor, within the process.

The compiler infrastructure is LLVM [1]_.

References
----------
.. [1] C. Lattner, V. Adve, LLVM: a compilation framework for lifelong program analysis and
   transformation, Int. Symp. on Code Generation and Optimization, 2004, 75-86.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import llvmlite
import llvmlite.binding as llvm

SPEED = 2
"""Optimisation level of LLVM's instruction selection."""


@cache
def _engine() -> tuple[Any, Any]:
    """Return the execution engine and the target machine."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=SPEED
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


def compile_text(text: str, suffix: str) -> bytes:
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


def load_object(content: bytes, names: tuple[str, ...], suffix: str) -> dict[str, int]:
    """Load an object file and return the addresses of its functions.

    The object file stays in memory for the lifetime of the process. The content comes from
    `compile_text` on the same machine, with the same suffix.
    """
    engine, _ = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    return {name: engine.get_function_address(f"{name}_{suffix}") for name in names}
