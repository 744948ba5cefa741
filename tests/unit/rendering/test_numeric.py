import pytest

from valerie.rendering.numeric import numeric_class


@pytest.mark.parametrize(
    ("renderer", "version", "expected"),
    [
        (
            "llvmpipe (LLVM 15.0.6, 256 bits)",
            "4.5 (Core Profile) Mesa 22.3.6",
            "llvmpipe-llvm-15.0.6-256-bits-mesa-22.3.6",
        ),
        (
            "NVIDIA H100 80GB HBM3/PCIe/SSE2",
            "4.6.0 NVIDIA 570.124.06",
            "nvidia-h100-80gb-hbm3-pcie-sse2-nvidia-570.124.06",
        ),
    ],
)
def test_the_class_names_renderer_and_driver(renderer: str, version: str, expected: str) -> None:
    assert numeric_class(renderer, version) == expected
