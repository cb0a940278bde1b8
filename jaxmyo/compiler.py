"""Settings of JAX's compiler: its defaults take long for programs as large as those of a solve, and gain little."""

#: For programs that run for milliseconds: half the time of compilation, and solves of small bodies are as fast.
QUICK: dict[str, str | bool] = {"xla_backend_optimization_level": "0", "xla_cpu_use_fusion_emitters": False}

#: For programs that run for seconds: batches of thousands of states run four times as fast, the default no faster.
LONG: dict[str, str | bool] = QUICK | {"xla_backend_optimization_level": "1"}

#: For the arithmetic of elements, and a solve of a small body: two thirds of the time of compilation by default, and it
#: runs as fast. (For float32 in curved coordinates, XLA's emitters of fusions take minutes.)
LEAN: dict[str, str | bool] = {"xla_cpu_use_fusion_emitters": False}
