"""The type checker that tests lay over the library: beartype, with integers welcome where floats are, as in mypy."""

from beartype import BeartypeConf, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
