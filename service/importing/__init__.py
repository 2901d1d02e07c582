"""Readings from files of tracker software: bytes in, observations or a refusal out (docs/import.md).

reading      files to readings: the way through; rows of all files put together by label
├── rows     which observation, target and state a row speaks of, and its numbers
├── layout   a table that is understood: its header, titles and remarks, the rows of data
│   └── header > grammar > phrases > words   where the header is, and what its columns mean, by their words
└── grid     rows of cells, of delimited text
    ├── joint_positions, joint_states   of a robot program, and of messages of ROS
    ├── point_reports, key_values   of points, and of numbers behind their names
    ├── listed_rows > number_lists   of lists in brackets
    ├── time_stamps   of lines of a log, which are no part of their words
    ├── json_rows   of objects
    ├── axis_rows   of points whose axes have a row each, joined
    ├── cell_units   without units in cells
    ├── blocks, adjacent_tables, transposed   of several blocks, of tables side by side, or of columns of
    │                                         postures, for the robot's proposal
    ├── excel    of workbooks
    ├── web_pages, latex > documents   of tables of web pages and of LaTeX
    ├── certificates, val3 > elements   of certificates and of data of VAL3, in XML
    └── arrays > libraries   of MATLAB, HDF5 and Parquet, in a process of its own (child)

Where names explain too little, the robot proposes what the columns mean (`proposals`); `posture_files` joins
files of one posture for it, `differences` finds displacements that positions state, too, and `legends` finds
what the files state of their words.

`expansion` expands files of xacro, in such a process, too.
`limits` has the greatest sizes of tables, for all of these.
"""
