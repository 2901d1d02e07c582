"""Pages of HTML as their reader sees them."""

import re
from html import unescape


def words_of(page: str) -> str:
    """Return all words of a page and its pictures; the cells of tables end with a bar."""
    page = re.sub(r"<(style|script)\b.*?</\1>", "", page, flags=re.DOTALL)
    page = re.sub(r"</?(b|i|em|strong|span|code|sup|sub)\b[^>]*>", "", page)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", re.sub(r"</t[hd]>", " | ", page))).split())
