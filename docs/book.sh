#!/usr/bin/env bash
# Builds the pages of docs/ as a book, and checks every link in it: docs/book.sh [FOLDER]
#
# Needs mdbook and python3. The book is FOLDER/docs (target/book by default), next to the files outside of docs/ that its
# pages link to. A warning of mdbook is an error.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
folder=${1:-$root/target/book}
rm -rf "$folder"
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
mdbook build --dest-dir "$folder/docs" "$root" 2>&1 | tee "$folder/log"
if grep -E 'WARN|ERROR' "$folder/log" >/dev/null; then
    echo "docs/book.sh: mdbook warns" >&2
    exit 1
fi
for name in config examples include; do
    cp -r "$root/$name" "$folder/$name"
done
# mdbook takes links to these for pages.
for name in recordings python; do
    mkdir "$folder/$name"
    {
        printf '<!doctype html><meta charset="utf-8"><title>%s</title><pre>\n' "$name"
        sed 's/&/\&amp;/g; s/</\&lt;/g' "$root/$name/README.md"
    } >"$folder/$name/README.html"
done
python3 - "$folder/docs" <<'PYTHON'
import pathlib, sys, urllib.parse
from html.parser import HTMLParser

class Page(HTMLParser):
    def __init__(self, path):
        super().__init__()
        self.links, self.anchors = [], {""}
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name in ("href", "src") and value:
                self.links.append(value)
            elif name in ("id", "name") and value:
                self.anchors.add(value)

root = pathlib.Path(sys.argv[1])
pages = {path.resolve(): Page(path) for path in root.rglob("*.html")}
broken, count = [], 0
for path, page in pages.items():
    # The printed book repeats all pages; a server shows the page of a missing one under any address.
    if path.name in ("404.html", "print.html", "toc.html"):
        continue
    for link in page.links:
        parts = urllib.parse.urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        count += 1
        target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
        anchor = urllib.parse.unquote(parts.fragment)
        if not target.exists() or target in pages and anchor not in pages[target].anchors:
            broken.append(f"{path.name}: {link}")
print("\n".join(broken) or f"{count} links of {len(pages)} pages resolve")
sys.exit(bool(broken))
PYTHON
