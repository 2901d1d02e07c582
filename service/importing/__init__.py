"""Readings from files of tracker software: bytes in, observations or a refusal out (docs/import.md).

reading        files to readings: the way through
├── file_types files that are no tables
├── assembly   records of all files put together by label
├── records    rows to records
│   ├── surroundings   times and temperatures
│   ├── names      which observation, target and state a row, a name and a file stand for
│   └── numbers    numbers, read strictly; the decimal mark
├── layout     the header in rows or a comment, the rows of data
│   ├── remarks    unit and frame in titles and comments
│   └── columns > header > words    what the columns mean
└── grid       rows of cells, of
    ├── text       delimited text and its encoding
    └── workbook > sheet > archive    Excel
"""
