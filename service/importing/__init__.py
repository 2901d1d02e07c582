"""Readings from files of tracker software: bytes in, observations or a refusal out (docs/import.md).

reading      files to readings: the way through; records of all files put together by label
├── records  rows to records; times and temperatures
├── names    which observation, target and state a row, a name and a file stand for
├── layout   the header in rows or a comment, titles and remarks, the rows of data
│   └── columns > grammar   what the columns mean, by their words
└── grid     rows of cells, of delimited text
    └── excel    of workbooks
"""
