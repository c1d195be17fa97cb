"""The method from end to end: the paper's, fast, fine, the bound Deformer, transfer.

Read in this order: `deform` (the method on one page), `proxies` (the samplings and their average), `proxy`
(sample and bind, solve, carry, correct), `start` (how a proxy is solved, and where that begins), `polish`
(full resolution), and `pieces` (meshes that are cut). `call` is the public function, `deformer` and
`sequence` keep proxies, and `transfer` puts meshes into known poses.
"""
