"""The editor behind ``sshade edit``: select vertices of a mesh in a browser, move them, and the mesh follows.

The folder ``page`` holds the page in the browser. :mod:`sshade.edit.server` answers its requests,
:mod:`sshade.edit.commands` translates them into calls of the :mod:`sshade.edit.session`, which works without
a browser. :mod:`sshade.edit.state` describes the steps that undo returns to, and :mod:`sshade.edit.workspace`
keeps them with the shape that is shown. :mod:`sshade.edit.groups` and :mod:`sshade.edit.selection` hold what
the steps do. :mod:`sshade.edit.dragging` has the options of steps of a drag, and
:mod:`sshade.edit.document` reads and writes files.
"""
