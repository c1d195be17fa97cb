# Move each vertex like its nearest handle:
#   awk -v output=output.txt -f nearest.awk handles.txt mesh.off
# A handle is a line "vertex x y z". The result has a line "x y z" for each vertex.

NR == FNR { handle[++handles] = $1; to_x[handles] = $2; to_y[handles] = $3; to_z[handles] = $4; next }
FNR == 2 { vertices = $1 }
FNR > 2 && FNR <= 2 + vertices { x[FNR - 3] = $1; y[FNR - 3] = $2; z[FNR - 3] = $3 }

END {
    for (h = 1; h <= handles; h++) {
        from_x[h] = x[handle[h]]; from_y[h] = y[handle[h]]; from_z[h] = z[handle[h]]
    }
    for (v = 0; v < vertices; v++) {
        nearest = -1
        for (h = 1; h <= handles; h++) {
            squared = (x[v] - from_x[h]) ^ 2 + (y[v] - from_y[h]) ^ 2 + (z[v] - from_z[h]) ^ 2
            if (nearest < 0 || squared < nearest) { nearest = squared; h_v = h }
        }
        printf "%.17g %.17g %.17g\n", x[v] + to_x[h_v] - from_x[h_v], y[v] + to_y[h_v] - from_y[h_v],
            z[v] + to_z[h_v] - from_z[h_v] > output
    }
}
