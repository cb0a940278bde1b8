"""Settings of JAX's compiler, whose default takes longer to compile than most of our programs run."""

#: For programs that run for milliseconds: half the time of compilation, and solves of small bodies are as fast.
QUICK: dict[str, str | bool] = {"xla_backend_optimization_level": "0", "xla_cpu_use_fusion_emitters": False}
#: For programs that run for seconds: batches of thousands of states run four times as fast, the default no faster.
LONG: dict[str, str | bool] = QUICK | {"xla_backend_optimization_level": "1"}
