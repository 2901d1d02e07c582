"""Times and memory of Jointstiff beside its peers, beside a bare call, or beside itself at another size."""
