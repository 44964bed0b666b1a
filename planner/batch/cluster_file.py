"""A file that defines the workers of a cluster: one of dask's cluster classes, its options, the number of workers.

```yaml
class: dask_jobqueue.SLURMCluster
options: {cores: 16, processes: 16, memory: 64GB, walltime: "02:00:00"}
workers: 64
```
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdplan.scenes.errors import InputError
from hdplan.scenes.fields import Field, read_document


@dataclass(frozen=True)
class ClusterFile:
    """Contents of the file."""

    kind: Field  # of the class, as module.Class
    options: Mapping[str, Any]
    workers: int

    @classmethod
    def read(cls, file: Path) -> ClusterFile:
        """Read a file. Raises InputError."""
        keys = read_document(file).mapping(("class", "options", "workers"), required=("class", "workers"))
        options = {name: each.value for name, each in keys["options"].mapping().items()} if "options" in keys else {}
        keys["class"].text()
        return cls(keys["class"], options, keys["workers"].integer(1, 100_000))

    @contextlib.contextmanager
    def started(self) -> Iterator[str]:
        """Yield the address of the cluster's scheduler; the cluster ends with the block. Raises InputError if there is
        no such class, or if it does not start."""
        module, _, name = self.kind.text().rpartition(".")
        try:
            found = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise self.kind.error(f"cannot be imported ({error})") from None
        if not hasattr(found, "scale"):
            raise self.kind.error(f"'{module}.{name}' is not one of dask's cluster classes")
        try:
            cluster = found(**self.options)
            cluster.scale(self.workers)
        except Exception as error:
            words = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{self.kind.document.file}: the cluster does not start ({words})") from None
        with cluster:
            yield cluster.scheduler_address
