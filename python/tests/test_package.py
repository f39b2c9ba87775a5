import inspect
import pathlib
import subprocess
import sys

import pytest

import grimace

PACKAGE = pathlib.Path(grimace.__file__).parent


def test_everything_exported_is_there_documented_and_typed():
    for name in grimace.__all__:
        item = getattr(grimace, name)
        if inspect.isfunction(item):
            assert item.__doc__, name
            assert "return" in item.__annotations__, name
            for parameter in inspect.signature(item).parameters.values():
                assert parameter.annotation is not inspect.Parameter.empty, f"{name}({parameter.name})"
        elif inspect.isclass(item):
            assert item.__doc__, name
    assert (PACKAGE / "py.typed").is_file() and (PACKAGE / "_grimace.pyi").is_file()


def test_the_native_half_is_as_its_stub_says():
    stub = (PACKAGE / "_grimace.pyi").read_text()
    native = {name for name in dir(grimace._grimace) if not name.startswith("__")}
    stubbed = {line.split("(")[0].split(":")[0].split()[-1] for line in stub.splitlines() if line.startswith(("def ", "class "))}
    assert native == stubbed


def test_no_opencv_is_linked():
    if not sys.platform.startswith("linux"):
        pytest.skip("ldd is Linux'")
    linked = subprocess.run(["ldd", grimace._grimace.__file__], capture_output=True, text=True, check=True).stdout
    assert "opencv" not in linked and "libc.so" in linked


def test_pandas_is_not_needed():
    code = "import sys; sys.modules['pandas'] = None; import grimace; print(grimace.candide3().neutral.shape)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "(113, 2)"
