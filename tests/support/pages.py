"""Pages of HTML as their reader sees them."""

import re
from html import unescape


def words_of(page: str) -> str:
    """Return all words of a page and its pictures; the cells of tables end with a bar."""
    page = re.sub(r"<(style|script)\b.*?</\1>", "", page, flags=re.DOTALL)
    page = re.sub(r"</?(b|i|em|strong|span|code|sup|sub)\b[^>]*>", "", page)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", re.sub(r"</t[hd]>", " | ", page))).split())


def lines_of_page(page: str) -> list[str]:
    """Return the lines of a page without its pictures; the cells of a row stand in one line."""
    page = re.sub(r"<(style|script|svg)\b.*?</\1>", "", page, flags=re.DOTALL)
    page = re.sub(r"</t[hd]>", " | ", page)
    page = re.sub(r"</?(b|i|em|strong|span|code|sup|sub|t[hd]|a|small)\b[^>]*>", "", page)
    lines = (" ".join(line.split()) for line in unescape(re.sub(r"<[^>]*>", "\n", page)).splitlines())
    return [line for line in lines if line]
