"""The page that a browser without a session sees: a field for the token."""

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>CoverNav Studio</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<style>
body {{ margin: 0; min-height: 100vh; display: grid; place-items: center; background: #14181b;
  color: #e8e6e1; font: 16px/1.5 system-ui, sans-serif }}
main {{ width: min(26rem, 90vw) }}
h1 {{ font-size: 1.3rem }}
p {{ color: #a9aca8 }}
form {{ display: flex; gap: .5rem }}
input {{ flex: 1; padding: .55rem .7rem; border: 1px solid #454c50; border-radius: 6px;
  background: #1d2326; color: inherit; font: inherit }}
button {{ padding: .55rem 1rem; border: 0; border-radius: 6px; background: #2f7d70; color: #fff;
  font: inherit }}
.wrong {{ color: #f0a35e }}
</style></head>
<body><main><h1>CoverNav Studio</h1>{note}
<p>Enter the token. It is in the address that <code>covernav serve</code> printed when it started.</p>
<form method="get">
<input type="password" name="token" aria-label="Token" autofocus autocomplete="current-password">
<button>Open the studio</button></form></main></body></html>"""

WRONG_TOKEN = '<p class="wrong" role="alert">That is not the token of this server.</p>'


def page(tried: bool) -> str:
    """The page; `tried` says that a token was given and is wrong."""
    return PAGE.format(note=WRONG_TOKEN if tried else "")
