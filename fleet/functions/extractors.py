"""Built-in extractors for pictures of plants; each gives one feature. `stalks` has the count of plants.

| extractor | feature | unit | range |
|---|---|---|---|
| excess_green | exg | grey levels | -510..510 |
| canopy_cover | cover | share of the pixels | 0..1 |
| leaf_area_index | lai | m2 of leaf a m2 of ground | 0..10 |
| brightness | brightness | share of full scale | 0..1 |
| blur | blur | grey levels squared | 0..1040400 |
| plant_count (stalks) | plants | plants in the picture | 0.. |
"""

from __future__ import annotations

import math

from fleet.contexts.base import Observation
from fleet.functions.compose import Feature, extractor
from fleet.functions.contract import SSV
from fleet.functions.vision import laplacian_variance, picture_of

EXTINCTION = 0.5
"""Share of light that a leaf layer takes at nadir when leaves point everywhere alike (spherical distribution)."""
MAX_LAI = 10.0


@extractor(Feature("exg", "grey levels", -510.0, 510.0))
def excess_green(observation: Observation) -> SSV:
    """Mean of 2G - R - B over the picture, from -510 (magenta) to 510 (pure green); 0 is grey.

    Source: Woebbecke et al. 1995, Transactions of the ASAE 38(1); used for yield by Khanal et al. 2018.
    """
    red, green, blue = picture_of(observation).means
    return {"exg": 2 * green - red - blue}


@extractor(Feature("cover", "1", 0.0, 1.0))
def canopy_cover(observation: Observation) -> SSV:
    """Share of the pixels that are plant, 0..1; a pixel is plant when ExG - ExR > 0.

    The threshold is fixed: Otsu's would split bare soil and closed canopy in two as well.
    Source: Meyer and Camargo Neto 2008, Computers and Electronics in Agriculture 63(2).
    """
    return {"cover": picture_of(observation).cover}


@extractor(Feature("lai", "m2/m2", 0.0, MAX_LAI))
def leaf_area_index(observation: Observation) -> SSV:
    """Leaf area over ground area from the gaps in the canopy, LAI = -ln(1 - cover) / k with k = 0.5, at most 10.

    Source: Beer-Lambert law of canopies, Monsi and Saeki 1953; k of a spherical leaf angle distribution seen from
    above, Campbell and Norman 1998, section 15.
    """
    gap = 1.0 - picture_of(observation).cover
    if gap <= math.exp(-EXTINCTION * MAX_LAI):
        return {"lai": MAX_LAI}
    return {"lai": max(0.0, -math.log(gap) / EXTINCTION)}


@extractor(Feature("brightness", "1", 0.0, 1.0))
def brightness(observation: Observation) -> SSV:
    """Mean luma 0.299 R + 0.587 G + 0.114 B over full scale, 0 (black) to 1 (white). Source: ITU-R BT.601."""
    red, green, blue = picture_of(observation).means
    return {"brightness": (0.299 * red + 0.587 * green + 0.114 * blue) / 255.0}


@extractor(Feature("blur", "grey levels squared", 0.0, 1040400.0))
def blur(observation: Observation) -> SSV:
    """Variance of the Laplacian of the grey picture: small when the picture is blurred, 0 when it is one colour.

    Source: Pech-Pacheco et al. 2000, ICPR, "Diatom autofocusing in brightfield microscopy".
    """
    return {"blur": laplacian_variance(picture_of(observation).grey)}
