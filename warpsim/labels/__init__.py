"""Labels: boxes, masks and tables of the targets in rendered images, and the files that networks are trained on."""

from warpsim.labels.boxes import mask_to_rle as mask_to_rle
from warpsim.labels.boxes import rle_to_mask as rle_to_mask
from warpsim.labels.coco import coco_categories as coco_categories
from warpsim.labels.coco import satnet_record as satnet_record
from warpsim.labels.coco import write_coco as write_coco
from warpsim.labels.table import label_table as label_table
from warpsim.labels.table import read_parquet as read_parquet
from warpsim.labels.table import write_parquet as write_parquet
