"""Score rows that the tests of tables, charts and pages share."""

from dataclasses import replace

from prtnet.score import NOISE_FLOOR, Row

NET = Row(
    scene="plants",
    method="net",
    material="diffuse",
    light="sky",
    reference="traced",
    psnr=44.51,
    psnr_worst=41.25,
    psnr_full=47.03,
    ssim=0.9871,
    ssim_full=0.9952,
    mae=0.0041,
    flip=None,
    ms=520.0,
    ms_ratio=8.14,
    macs=17_300,
    bytes=70_123,
    bake_seconds=12.3,
    train_seconds=61.0,
    clipped=0.0123,
    views=8,
)
TEXTURE = replace(
    NET, method="texture", psnr=46.92, macs=275, bytes=117_440_512, ms=64.0, ms_ratio=1.0, train_seconds=None
)
FLOOR = replace(
    NET, method=NOISE_FLOOR, psnr=56.13, psnr_worst=56.13, ms=None, ms_ratio=None, macs=None, bytes=None, views=1,
    bake_seconds=None, train_seconds=None,
)  # fmt: skip
ROWS = [FLOOR, TEXTURE, NET, replace(NET, method="net_published", psnr=41.18)]
BOTH_REFERENCES = [*ROWS, replace(NET, reference="texture", psnr=45.05)]
TWO_SCENES = [*ROWS, *(replace(row, scene="room") for row in ROWS)]
