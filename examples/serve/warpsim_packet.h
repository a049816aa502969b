/* Packets and rings of `warpsim serve`, version 1: little endian, no padding. Needs nothing of warpsim. */
#ifndef WARPSIM_PACKET_H
#define WARPSIM_PACKET_H

#include <stdint.h>

#define WARPSIM_LATE 1u    /* sent after its time was over */
#define WARPSIM_SLEWING 2u /* the camera slews or settles */

struct warpsim_packet {       /* byte */
  char magic[8];              /*   0  "WARPSIM" */
  uint32_t version;           /*   8  1 */
  uint32_t header_bytes;      /*  12  320: where the counts begin */
  uint64_t sequence;          /*  16  packets of this server before it; a gap is a packet that you have lost */
  uint64_t frame;             /*  24  frame number in the scene; a gap is a frame that the server has dropped */
  double time_s;              /*  32  middle of the exposure, after the scene's epoch [s] */
  int64_t due_unix_ns;        /*  40  when the frame was due, Unix time [ns] */
  int64_t sent_unix_ns;       /*  48  when sending of its packets began */
  uint32_t loop;              /*  56  passes through the scene before this one */
  uint32_t flags;             /*  60  WARPSIM_LATE, WARPSIM_SLEWING */
  uint32_t sensor;            /*  64  index among the sensors of the server */
  uint32_t band;              /*  68  index among its bands */
  uint32_t n_sensor;          /*  72 */
  uint32_t n_band;            /*  76  a frame is n_sensor x n_band packets */
  uint32_t n_row;             /*  80 */
  uint32_t n_col;             /*  84 */
  char dtype[8];              /*  88  "<u2" */
  uint64_t payload_bytes;     /*  96  2 n_row n_col */
  uint32_t payload_crc32;     /* 104  of the counts, as zlib's crc32 */
  uint32_t reserved;          /* 108 */
  double position_m[3];       /* 112  of the sensor, geocentric, GCRS axes [m] */
  double velocity_m_s[3];     /* 136  likewise [m/s] */
  double quaternion[4];       /* 160  x, y, z, w of the rotation from GCRS to camera axes */
  char utc[32];               /* 192  the same time, ISO 8601 */
  char sensor_name[64];       /* 224  UTF-8, cut where it is longer */
  char band_name[24];         /* 288 */
  uint32_t more_reserved;     /* 312 */
  uint32_t header_crc32;      /* 316  of all bytes before */
  uint16_t counts[];          /* 320  row by row */
};

struct warpsim_ring {    /* at byte 0 of the file; the scene's description, JSON, is at byte 128 */
  char magic[8];         /*   0  "WSRING", written last */
  uint32_t version;      /*   8  1 */
  uint32_t closed;       /*  12  1 once the server has ended */
  uint64_t first_slot;   /*  16  where slot 0 is [bytes] */
  uint64_t n_slot;       /*  24 */
  uint64_t slot_bytes;   /*  32  from slot to slot */
  uint64_t packet_bytes; /*  40  size of a packet */
  uint64_t text_bytes;   /*  48  of the description */
  uint64_t pid;          /*  56  of the server */
  uint64_t written;      /*  64  packets that are complete: packet k is in slot k % n_slot */
};

struct warpsim_slot { /* followed by the packet */
  uint64_t guard;     /* 2 k + 1 while packet k is written, then 2 k + 2 */
  char unused[56];
};

#endif
