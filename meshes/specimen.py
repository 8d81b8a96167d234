"""Rectangular specimen: structured (crossed, left, right), unstructured or with edges along yarns,
of triangles or quadrilaterals.

python3 meshes/specimen.py --length 200 --width 50 --nx 100 --ny 25 --pattern crossed --out
specimen.msh
"""

from fabric_fenicsx.meshes.specimen import main

if __name__ == "__main__":
    main()
