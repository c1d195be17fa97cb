"""The method from end to end: the paper's, fast and fine, as one bound object; transfer of poses.

Read in this order: `bound` (the method on one page), `piece` (a connected part and its proxies: sample, bind,
solve, carry, average), `proxy_solver` (how a proxy is solved, and where that begins), `polish` (full
resolution), `assembly` and `junctions` (meshes that are cut). `call` is the public function, `sequence`
solves pose after pose, and `transfer` puts meshes into known poses.
"""
