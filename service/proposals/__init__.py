"""Proposals for the meaning of files: the robot finds the meaning of their columns, a person accepts it.

answers             imports by names, or else by the proposal of the robot
└── search          choices of sheets, joints and rows, which are tried
    ├── joined_tables > names, tables   tables of numbers, with their rows in one order by their names
    ├── found_meaning                   columns of joints and positions by the robot, in one unit
    ├── completion                      names of targets and states, loads, and what the files leave open
    │   ├── columns > tables            columns that are not read, or that the caller states
    │   ├── forces > columns            columns, units and axes of forces, and weights that hang
    │   ├── refusals, refused_states, repeated_postures, nominal_positions   what a person cannot accept
    │   └── rewriting, previews > proposed_import   the table to import, and what a person reads of it
    ├── templates                       the same meaning as in files that were accepted before
    └── lone_deflections                displacements without positions
"""
