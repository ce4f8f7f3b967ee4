"""The machine that code is made for: LLVM, for this processor, within this process.

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
"""How hard LLVM tries to choose instructions."""


@cache
def _engine() -> tuple[Any, Any]:
    """What runs code, and the processor that it is made for."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=SPEED
    )
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), target), target


@cache
def processor() -> str:
    """What the code depends on besides its text: the processor and the compiler."""
    features = llvm.get_host_cpu_features().flatten()
    version = ".".join(map(str, llvm.llvm_version_info))
    return f"{llvm.get_host_cpu_name()} {features} LLVM {version} llvmlite {llvmlite.__version__}"


@cache
def _passes() -> Any:
    """What makes such text fast: all passes of the usual level take twice as long for 2 %."""
    passes = llvm.create_new_function_pass_manager()
    passes.add_sroa_pass()
    passes.add_new_gvn_pass()
    passes.add_instruction_combine_pass()
    return passes


def compile_text(text: str, suffix: str) -> bytes:
    """An object file of a module, optimised for this processor.

    Parameters
    ----------
    text : str
        In LLVM's language.
    suffix : str
        That the names of its functions get, so that no two objects share one.

    Returns
    -------
    bytes
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
    """Addresses of the functions of an object file; it stays in memory as long as the process.

    Parameters
    ----------
    content : bytes
        From `compile_text`, of this very machine.
    names : tuple of str
    suffix : str
        That it was compiled with.

    Returns
    -------
    dict of str to int
    """
    engine, _ = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    return {name: engine.get_function_address(f"{name}_{suffix}") for name in names}
