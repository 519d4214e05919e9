"""How long small questions take: while nothing goes on, while all workers are busy, and among a crowd."""
