"""A fabric with and without its couplings, as studies compare them."""

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.material.laws import Law


def coupling_variants(fabric: Law) -> dict[str, Law]:
    """{label: fabric} with all couplings, without some, and the decoupled baseline, as Figs 10 and
    16 of the paper compare them. InputError for a fabric without couplings."""
    variants = {
        "all couplings": fabric,
        "without biaxial": fabric.without("biaxial"),
        "without shear couplings": fabric.without("tension_shear", "compression_shear"),
        "FABRIC": fabric.decoupled(),
    }
    if not fabric.couplings:
        raise InputError(
            f"the fabric, of law {fabric.law}, has "
            "none; expected a fabric with couplings, as komeili"
        )
    return variants
