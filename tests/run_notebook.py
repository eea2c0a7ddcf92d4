"""Execute a notebook in text form with this interpreter: python run_notebook.py NOTEBOOK."""

import sys
import tempfile
from pathlib import Path

import jupytext
from jupyter_client.kernelspec import KernelSpec, KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient


class ThisPython(KernelSpecManager):
    """Knows one kernel: the interpreter of the test run. Nothing is registered anywhere."""

    def get_kernel_spec(self, kernel_name: str) -> KernelSpec:
        return KernelSpec(
            argv=[sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"],
            display_name=kernel_name,
            language="python",
        )


def main(path: Path) -> None:
    kernel = AsyncKernelManager(kernel_name="python3", kernel_spec_manager=ThisPython())
    with tempfile.TemporaryDirectory() as folder:
        where = {"metadata": {"path": folder}}
        NotebookClient(jupytext.read(path), km=kernel, timeout=300, resources=where).execute()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
