"""Triangles of the double dome's surface, a quarter or all of it, finer on its roundings, for
ParaView and as a tool; or the dome as a solid in a STEP file.

python3 meshes/double_dome.py --depth 60 --saddle-depth 15 --size 10 --turn 10 --out double_dome.stl
python3 meshes/double_dome.py --depth 60 --saddle-depth 15 --out double_dome.step
"""

from fabric_fenicsx.meshes.double_dome import main

if __name__ == "__main__":
    main()
