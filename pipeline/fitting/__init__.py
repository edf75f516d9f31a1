"""How models are fitted: every one of a variant (`grid`), or by stages that only want their answers (`trainers`)."""
