"""Steps from layout to layout, one file each in `versions/`; `upgrading.py` carries them out by Alembic.

A file has three parts:

* `revision`: name of the layout, `NNNN_expand_words` or `NNNN_contract_words`. An *expand* step only adds:
  nullable columns or columns with a default, tables, indexes. Older programs work on as before. A *contract*
  step removes what no program needs any more, at the earliest one release later.
* `upgrade()`: the change of the tables, one transaction on SQLite and on PostgreSQL.
* *documents*, if the form of documents changes: `SCHEMA`, `TABLES` and `rewrite`. The leading worker rewrites
  the rows whose `schema` is less than `SCHEMA`, in portions (`rewriting.py`). Programs of the layout before
  must be able to read the new form.

A file never changes after its release, so a file uses no other module of ours, except readers of old forms.
There are no downgrades: restore the copy that was made before the upgrade.
"""
