"""A mesh of your own: a strip with a hole, meshed by gmsh, pulled along its yarns.

Prints the reaction [N].
"""

import gmsh

import fabric_fenicsx as ff

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
plate = gmsh.model.occ.addRectangle(0, 0, 0, 100, 50)
hole = gmsh.model.occ.addDisk(50, 25, 0, 10, 10)
gmsh.model.occ.cut([(2, plate)], [(2, hole)])
gmsh.model.occ.synchronize()
gmsh.model.addPhysicalGroup(2, [s for _, s in gmsh.model.getEntities(2)])
gmsh.option.setNumber("Mesh.MeshSizeMax", 5)
gmsh.model.mesh.generate(2)
gmsh.write("hole.msh")
gmsh.finalize()

ply = ff.Blank.read("hole.msh", a=0.0, degree=2)  # yarns a along x, b across; quadratic cells
scene = ff.Scene(ply, [ff.Membrane(ff.load("komeili"))], supports=ff.clamped_ends(1.0))
result = ff.Job(scene, steps=4).run()
print(round(result.summary["reaction_N"], 1))
result.plot("log_eps_11", "own_mesh.png")
