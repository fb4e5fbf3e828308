"""The documents as pages for a browser, as the extension carries them: {path: text} by `pages()`.

It knows the Markdown that they are written in: headings, paragraphs, lists, tables, blocks of code, links,
bold, italics and code. Pictures are left out; they are as large as the rest of the extension.
"""

from __future__ import annotations

import html
import re
from pathlib import Path, PurePosixPath

from strata.addon.effects.registry import EFFECTS
from strata.scripts.build.effect_docs import page

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = {
    **{f"docs/effects/{effect.id}.md": f"{effect.id}.html" for effect in EFFECTS},
    **{f"addon/effects/{effect.id}/README.md": f"{effect.id}_notes.html" for effect in EFFECTS},
    "docs/preview.md": "preview.html",
    "docs/accuracy.md": "accuracy.html",
    "docs/report.md": "report.html",
    "docs/performance.md": "performance.html",
    "docs/trace.md": "trace.html",
    "docs/stability.md": "stability.html",
    "docs/analytic.md": "analytic.html",
    "docs/architecture.md": "architecture.html",
    "docs/new_effect.md": "new_effect.html",
    "CHANGELOG.md": "changes.html",
}
INDEX = "index.html"
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 56em; margin: 2em auto; padding: 0 1em;
       color: #222; background: #fff; }
table { border-collapse: collapse; display: block; overflow-x: auto; margin: 1em 0; }
td, th { border: 1px solid #ccc; padding: .3em .6em; text-align: left; vertical-align: top; }
code, pre { background: #f3f3f3; font-size: .9em; } pre { padding: .8em; overflow-x: auto; }
a { color: #06c; }
@media (prefers-color-scheme: dark) {
  body { color: #ddd; background: #222; } code, pre { background: #333; } td, th { border-color: #555; }
  a { color: #7bf; } }
"""


def pages() -> dict[str, str]:
    """HTML by file name, all in one folder."""
    made = {f"docs/effects/{effect.id}.md": page(effect) for effect in EFFECTS}
    texts = {source: made.get(source) or (ROOT / source).read_text("utf-8") for source in DOCUMENTS}
    found = {DOCUMENTS[source]: _page(source, text) for source, text in texts.items()}
    found[INDEX] = _page("README.md", _index(texts))
    return found


def _index(texts: dict[str, str]) -> str:
    """What the README says of Strata and how to use it, and all other pages."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    intro = readme.partition("## Two commands")[0]
    use = "## Five ways" + readme.partition("## Five ways")[2].partition("## More")[0]
    links = "\n".join(f"- [{_title(source, text)}]({source})" for source, text in texts.items())
    return f"{intro}\n{use}\n## All pages\n\n{links}\n"


def _title(source: str, text: str) -> str:
    title = text.partition("# ")[2].splitlines()[0]
    return f"{title}: how it works" if source.startswith("addon/") else title


def _page(source: str, text: str) -> str:
    title = _title(source, text)
    back = "" if source == "README.md" else f'<p><a href="{INDEX}">Strata</a></p>\n'
    head = f'<meta charset="utf-8"><title>{html.escape(title.replace("`", ""))}</title><style>{STYLE}</style>'
    return f"<!DOCTYPE html>\n<html><head>{head}</head><body>\n{back}{_body(source, text)}</body></html>\n"


def _body(source: str, text: str) -> str:
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    blocks = re.split(r"(^```[^\n]*\n.*?^```$)", text, flags=re.DOTALL | re.MULTILINE)
    made = []
    for block in blocks:
        if block.startswith("```"):
            code = block.partition("\n")[2].removesuffix("```")
            made.append(f"<pre>{html.escape(code)}</pre>\n")
        else:
            made += (_block(source, each) for each in re.split(r"\n\s*\n", block) if each.strip())
    return "".join(made)


def _block(source: str, block: str) -> str:
    """A heading with what follows it, a table, a list or a paragraph."""
    lines = [line for line in block.splitlines() if line.strip()]
    if heading := re.match(r"(#+) (.*)", lines[0]):
        level, words = len(heading[1]), heading[2]
        made = f'<h{level} id="{_anchor(words)}">{_inline(source, words)}</h{level}>\n'
        return made + (_block(source, "\n".join(lines[1:])) if lines[1:] else "")
    if lines[0].startswith("|"):
        return _table(source, lines)
    if item := re.match(r"(- |\d+\. )", lines[0]):
        kind = "ul" if item[1] == "- " else "ol"
        items = re.split(r"^(?:- |\d+\. )", "\n".join(lines), flags=re.MULTILINE)[1:]
        return f"<{kind}>" + "".join(f"<li>{_inline(source, each)}</li>\n" for each in items) + f"</{kind}>\n"
    words = _inline(source, " ".join(line.strip() for line in lines))
    return f"<p>{words}</p>\n" if words.strip() else ""


def _table(source: str, lines: list[str]) -> str:
    rows = [re.split(r"(?<!\\)\|", line.strip().strip("|")) for line in lines]
    made = []
    for number, row in enumerate(rows):
        if number != 1:  # the line under the head
            cell = "td" if number else "th"
            cells = (
                f"<{cell}>{_inline(source, each.strip().replace(chr(92) + '|', '|'))}</{cell}>"
                for each in row
            )
            made.append(f"<tr>{''.join(cells)}</tr>\n")
    return f"<table>{''.join(made)}</table>\n"


def _inline(source: str, text: str) -> str:
    """Words within a block; code is left as it is."""
    parts = re.split(r"(`[^`]+`)", re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text))
    return _linked(
        source, "".join(f"<code>{html.escape(p[1:-1])}</code>" if p[:1] == "`" else _styled(p) for p in parts)
    )


def _styled(text: str) -> str:
    text = html.escape(text, quote=False)
    text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", text, flags=re.DOTALL)
    return re.sub(r"(?<![\w*])\*(?=\S)([^*]+?)\*(?![\w*])", r"<i>\1</i>", text)


def _linked(source: str, text: str) -> str:
    """Links lead to the pages that are there; of others only the words stay."""

    def link(match: re.Match) -> str:
        words, target = match[1], match[2]
        if not target.startswith(("http://", "https://")):
            path, _, anchor = target.partition("#")
            target = _target(source, path)
            target = f"{target}#{anchor}" if target and anchor else target
        return f'<a href="{target}">{words}</a>' if target else words

    return re.sub(r"\[((?:[^\[\]]|\n)+)\]\(([^)\s]+)\)", link, text)


def _target(source: str, path: str) -> str:
    """The page of a document that one at `source` links to, empty where there is none."""
    parts: list[str] = []
    for part in (PurePosixPath(source).parent / path).parts:
        parts = parts[:-1] if part == ".." else [*parts, part]
    document = "/".join(parts)
    return INDEX if document == "README.md" else DOCUMENTS.get(document, "")


def _anchor(words: str) -> str:
    """As GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
