"""Texts of test curves as a user writes them, and a folder of them."""

SHEET = 'name = "x"\nthickness_mm = 1.2\ndensity_g_per_cm3 = 0.6\nbalanced = true\n'
UNIAXIAL = """# any remark: is ignored
# test: uniaxial_a
# lateral: held
# noise: 2 % of maximum
eps_a [%],sigma_a [MPa]
0.5,6.9
1,14.5

1.5,22.8
2,31.6
2.5,41.1
"""
FREE = UNIAXIAL.replace("held", "free")
WIDENED = "# test: uniaxial_b\n# lateral: free\neps_b [%],sigma_b [MPa],eps_a [%]\n" + "".join(
    f"{i},{i},{i * 2}\n" for i in range(1, 6)
)
SHEAR = "# test: shear\ngamma [deg],F_sh [N/mm]\n10,0.016\n20,0.035\n30,0.056\n35,0.078\n40,0.110\n"
BIAS = (
    "# test: bias_extension\n# height: 230 mm\n# width: 11.5 cm\ngamma [deg],F [N]\n"
    "10,1\n20,2\n30,3\n35,4\n40,5\n"
)


def folder(tmp_path, sheet=SHEET, **files):
    (tmp_path / "sheet.toml").write_text(sheet)
    for name, text in files.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    return tmp_path
