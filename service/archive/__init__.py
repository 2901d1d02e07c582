"""Archives: a database as a zip file of JSON lines, which needs no program of ours to be read.

`manifest.json` names the layout, and for each file its lines, bytes and SHA-256. Each line of a file is a
JSON object: the columns of a row, and its documents as JSON. `writing.py` writes archives of every layout
from 0018 on, `restoring.py` restores them into a database of today's layout.
"""
