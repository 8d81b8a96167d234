"""Both bias tests of glass/PP of Cao et al. (2008): measured, fitted and simulated.

Prints for each specimen and measured shear angle [deg] the normalised shear force [N/mm], and over
it that of the fitted law and that of the simulated test.
"""

from importlib.resources import files

import numpy as np

import fabric_fenicsx as ff
from fabric_fenicsx import identification
from fabric_fenicsx.identification import curves

data = files("fabric_fenicsx") / "studies/data"
for width, length, strain in ((115, 230, 0.1535), (150, 450, 0.2195)):
    folder = str(data / f"glass_pp_{width}x{length}")
    law = identification.identify(*curves.read(folder)).fabric
    sizes = {"length": length, "width": width, "strain": strain, "nx": 24}
    test = ff.BiasExtension(law, **sizes, measured=folder).build()
    result = test.job(steps=20).run()
    angles, measured, simulated = test.against_measured(result.rows)
    stress = law.derivatives(0 * angles, 0 * angles, angles, second=False).first[2]
    fitted = law.thickness * stress / np.cos(angles)  # F_sh of homogeneous shear
    for row in zip(np.degrees(angles), measured, fitted / measured, simulated / measured):
        print(f"{width}x{length} {row[0]:.0f} {row[1]} {row[2]:.3f} {row[3]:.3f}")
