"""Triangles in an outline with holes, from a drawing (DXF), a table of points (CSV) or the boundary
of a mesh.

python3 meshes/outline.py blank.dxf --size 8 --out blank.msh
"""

from fabric_fenicsx.meshes.outline import main

if __name__ == "__main__":
    main()
