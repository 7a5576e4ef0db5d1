"""The numbers that decide something in reading files; what a file may ask for at most stands in ``dynid.limits``."""

#: Messages that are decoded together, and bytes of messages that are kept before [byte]: large enough for NumPy, small
#: enough to be forgotten soon. Evidence: benchmarks/read_bag.md (speed and peak memory of an hour).
MESSAGES = 4096
MESSAGE_BYTES = 8 << 20
#: Messages of one layout below which they are put together with others. Evidence: benchmarks/read_bag.md.
FEW_MESSAGES = 64
#: Least share of distinct header stamps among the messages of a topic: a clock ticks. Evidence: none yet.
LEAST_DISTINCT = 0.5
#: Records of one length in a row from which on it is tried whether those after them have it too.
#: Evidence: benchmarks/read_bag.md.
ALIKE_RECORDS = 16
#: Lines from which the dialect of a table is told, rows of numbers among them, and bytes from which its encoding is
#: told [byte]. Evidence: tests/unit/files/test_tables_of_other_programs.py (headers of up to some tens of lines).
FIRST_LINES, FIRST_ROWS, ENCODED_BYTES = 200, 40, 1 << 16
#: Rows of a table that are turned into numbers together. Evidence: none yet.
ROWS = 20_000
