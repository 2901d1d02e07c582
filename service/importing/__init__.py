"""Readings from files of tracker software: bytes in, observations or a refusal out (docs/import.md).

reading        files to readings: the way through
├── file_types files that are no tables
├── preview    what was understood, in words
├── assembly   records of all files put together by label
├── records    rows to records
│   ├── names      which observation, target and state a row, a name and a file stand for
│   └── numbers    numbers, read strictly; the decimal mark
├── layout     the header in rows or a comment, unit and frame in comments, the rows of data
│   └── columns > header > words    what the columns mean
└── grid       rows of cells, of
    ├── text       delimited text and its encoding
    └── workbook > sheet > archive    Excel
"""
