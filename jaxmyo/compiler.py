"""Settings of JAX's compiler for programs that run for milliseconds and compile for seconds."""

#: The cheapest ones: half the time of compilation, and solves of small bodies are as fast.
QUICK: dict[str, str | bool] = {"xla_backend_optimization_level": "0", "xla_cpu_use_fusion_emitters": False}

#: Two thirds of the time of compilation, for the arithmetic of elements; it runs as fast.
LEAN: dict[str, str | bool] = {"xla_cpu_use_fusion_emitters": False}
