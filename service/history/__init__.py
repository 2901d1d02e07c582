"""Versions of documents: steps raise documents from version to version, so that today's code reads them.

The version of a document is the number of the layout of the database in which such documents were first
stored. Documents without a version, such as saved files and answers of older services, count as the oldest:
a step changes only what has the old shape. Three rules:

* No step changes a number, and no step computes a number.
* A field that a later version has no place for is named in `Step.dropped`.
* A field that an older version lacks is null, or has its default; it was *not recorded by version …*.
"""
