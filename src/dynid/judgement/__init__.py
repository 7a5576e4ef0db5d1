"""From evidence to statements: one object of numbers, one pure function, one table of thresholds."""
