"""CasADi Functions as static functions of one C file: without the tables that CasADi adds for its own loader."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

# Of a Function: what only CasADi's loader uses; what is seen from outside; arguments that may be unused; tables.
LOADER = r"^[^\n;{{}}]*\b{name}_\w+\([^\n;{{}}]*\) ?\{{(?:[^\n]+\}}\n+|\n.*?^\}}\n+)"
SEEN = re.compile(r"^(?=(?:void|int|casadi_int|casadi_real) \w+\([^;{]*\) ?\{)", re.MULTILINE)
TAKEN = re.compile(r"(\(const casadi_real\*\* arg, [^;{]*int mem\)) ?\{\n")
UNUSED = "  (void)arg; (void)res; (void)iw; (void)w; (void)mem;\n"
SPARSITY = re.compile(r"^static const casadi_int (casadi_s\d+)\[\d+\] = \{[^}]*\};\n+", re.MULTILINE)


@dataclass(frozen=True)
class Kernels:
    """C source of some Functions, and the memory that any of them needs."""

    source: str
    arguments: int
    results: int
    integers: int
    numbers: int  # doubles


def kernels(prefix: str, functions: Sequence[ca.Function]) -> Kernels:
    """Return the Functions in C99, each by its name as ``int name(arg, res, iw, w, 0)``, CasADi's C interface."""
    options: Any = {"with_header": False, "with_export": False, "casadi_int": "int"}
    generator = ca.CodeGenerator(f"{prefix}.c", options)
    for function in functions:
        generator.add(function, False)
    source = generator.dump()
    for name in (f"{prefix}_casadi", *(function.name() for function in functions)):
        source = re.sub(LOADER.format(name=re.escape(name)), "", source, flags=re.MULTILINE | re.DOTALL)
    source = TAKEN.sub(rf"\1 {{\n{UNUSED}", SEEN.sub("static ", source))
    for found in list(SPARSITY.finditer(source)):
        if len(re.findall(rf"\b{found[1]}\b", source)) == 2:  # its #define, and itself
            source = source.replace(found[0], "").replace(f"#define {found[1]} CASADI_PREFIX({found[1][7:]})\n", "")
    sizes = ((each.sz_arg(), each.sz_res(), each.sz_iw(), each.sz_w()) for each in functions)
    return Kernels(source, *(max(1, *column) for column in zip(*sizes, strict=True)))
