"""The sections of the report, each a module: what the page shows of a result, without the page."""
