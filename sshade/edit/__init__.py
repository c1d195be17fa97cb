"""The editor behind ``sshade edit``: regions of a mesh are picked and moved in a browser, and it follows.

:mod:`sshade.edit.state` is what undo goes back to, :mod:`sshade.edit.history` how;
:mod:`sshade.edit.follower` deforms while the mouse moves and when it rests, :mod:`sshade.edit.session` does
what a person asks for, without any browser, :mod:`sshade.edit.saving` says which files may be written,
:mod:`sshade.edit.server` lends a session to a page, and the folder ``page`` is that page.
"""
