/* Reads the packets of `warpsim serve SCENE --ring NAME` from shared memory: POSIX and flock, nothing of warpsim.

     cc -O2 -o subscriber examples/serve/subscriber.c
     ./subscriber /dev/shm/NAME [COUNT [FILE]]

   Prints a line per packet until COUNT packets have come or the server ends; FILE takes them as they are. Status 1: some
   were damaged, or the server was killed. */
#define _POSIX_C_SOURCE 200809L
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "warpsim_packet.h"

_Static_assert(sizeof(struct warpsim_packet) == 320, "layout");

static uint64_t load(const uint64_t *at) { return __atomic_load_n(at, __ATOMIC_ACQUIRE); }

/* CRC-32 of zlib, PNG and Ethernet. */
static uint32_t crc32_of(const unsigned char *bytes, size_t n) {
  static uint32_t table[256];
  if (!table[1])
    for (uint32_t i = 0; i < 256; i++) {
      uint32_t c = i;
      for (int bit = 0; bit < 8; bit++) c = c & 1 ? 0xEDB88320u ^ (c >> 1) : c >> 1;
      table[i] = c;
    }
  uint32_t c = 0xFFFFFFFFu;
  for (size_t i = 0; i < n; i++) c = table[(c ^ bytes[i]) & 0xFF] ^ (c >> 8);
  return c ^ 0xFFFFFFFFu;
}

/* Packet k, copied; 0 if it has been overwritten meanwhile. */
static int read_packet(const struct warpsim_ring *ring, uint64_t k, struct warpsim_packet *to) {
  const char *at = (const char *)ring + ring->first_slot + (k % ring->n_slot) * ring->slot_bytes;
  const struct warpsim_slot *slot = (const struct warpsim_slot *)at;
  if (load(&slot->guard) != 2 * k + 2) return 0;
  memcpy(to, slot + 1, ring->packet_bytes);
  __atomic_thread_fence(__ATOMIC_ACQUIRE);
  return load(&slot->guard) == 2 * k + 2;
}

int main(int argc, char **argv) {
  if (argc < 2) return fprintf(stderr, "usage: %s RING [COUNT [FILE]]\n", argv[0]), 2;
  uint64_t left = argc > 2 ? strtoull(argv[2], NULL, 10) : UINT64_MAX, overtaken = 0, damaged = 0;
  int gone = 0;
  FILE *out = argc > 3 ? fopen(argv[3], "wb") : NULL;
  const struct timespec nap = {0, 100000}; /* 0.1 ms */
  int file = open(argv[1], O_RDONLY);
  struct stat about;
  if (file < 0 || fstat(file, &about)) return perror(argv[1]), 1;
  const struct warpsim_ring *ring = mmap(NULL, (size_t)about.st_size, PROT_READ, MAP_SHARED, file, 0);
  if (ring == MAP_FAILED) return perror(argv[1]), 1;
  if (strncmp(ring->magic, "WSRING", 8) || ring->version != 1) return fprintf(stderr, "no ring of version 1\n"), 1;

  struct warpsim_packet *packet = malloc(ring->packet_bytes);
  uint64_t written = load(&ring->written), k = written > ring->n_slot / 2 ? written - ring->n_slot / 2 : 0;
  for (int naps = 0; left;) {
    if (k == (written = load(&ring->written))) {
      if (__atomic_load_n(&ring->closed, __ATOMIC_ACQUIRE) && k == load(&ring->written)) break;
      if (++naps % 1000 == 0 && !flock(file, LOCK_SH | LOCK_NB)) { /* its server has this lock while it lives */
        gone = k == load(&ring->written) && !__atomic_load_n(&ring->closed, __ATOMIC_ACQUIRE);
        if (gone) break;
        flock(file, LOCK_UN);
      }
      nanosleep(&nap, NULL);
      continue;
    }
    if (!read_packet(ring, k, packet)) { /* too slow: go on with what is half as old as the ring is long */
      uint64_t ahead = written > ring->n_slot / 2 ? written - ring->n_slot / 2 : 0;
      if (ahead > k) overtaken += ahead - k, k = ahead;
      continue;
    }
    k++, left--;
    damaged += crc32_of((unsigned char *)packet->counts, packet->payload_bytes) != packet->payload_crc32;
    printf("%llu: frame %llu, %s, %s in %s, flags %u, first count %u\n", (unsigned long long)packet->sequence,
           (unsigned long long)packet->frame, packet->utc, packet->sensor_name, packet->band_name, packet->flags,
           packet->counts[0]);
    if (out) fwrite(packet, ring->packet_bytes, 1, out);
  }
  if (out) fclose(out);
  fprintf(stderr, "%llu overtaken, %llu damaged\n", (unsigned long long)overtaken, (unsigned long long)damaged);
  if (gone) fprintf(stderr, "the server has gone\n");
  return damaged || gone;
}
