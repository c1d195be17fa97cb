"""The method from end to end: the paper's, fast, fine, the bound Deformer, components, transfer.

Read in this order: `deform` (the entry), `components` (meshes that are cut), `engine` (one connected mesh)
with `proxies` and `regions`, `initialise` (where the proxy solve begins), and `polish` (full resolution).
`deformer` and `drag` serve interactive edits, and `transfer` known poses.
"""
