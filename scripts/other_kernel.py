"""Prints a kernel of OpenBLAS that this processor can run and does not choose by itself."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from threadpoolctl import ThreadpoolController

np.linalg.inv(np.eye(2))  # BLAS is loaded
chosen = {library.get("architecture") for library in ThreadpoolController().info()}
processor = Path("/proc/cpuinfo")
wide = processor.is_file() and {"avx512f", "avx512bw", "avx512vl"} <= set(processor.read_text().split())
narrow = "Sandybridge" if chosen & {"Haswell", "Zen"} else "Haswell"
sys.stdout.write("SkylakeX" if wide and "SkylakeX" not in chosen else narrow)
