"""Kill -9 while jobs flow, then check the books."""
