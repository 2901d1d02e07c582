"""Readings from files of tracker software: bytes in, observations or a refusal out (docs/import.md).

reading        files to readings: the way through
├── file_types files that are no tables
├── preview    what was understood, in words
├── assembly   records of all files put together by label
├── records    rows to records
│   ├── row_names > naming    which observation, target and state a row and a name stand for
│   ├── row_order  labels of rows without names
│   └── numbers    numbers, read strictly; the decimal mark
├── layout     the rows of data below a header
│   ├── heading    where the header is: in rows, or in a comment
│   ├── comments   unit and frame that comments say
│   └── columns > column_units > header > words, units    what the columns mean
└── grid       rows of cells, of
    ├── text > encoding      delimited text
    └── workbook > sheet > archive    Excel
"""
