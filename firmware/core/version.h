#ifndef ORI_VERSION_H
#define ORI_VERSION_H

/* Major, minor and patch in the three upper bytes. */
#define ORI_FIRMWARE_VERSION UINT32_C(0x01000000)

#endif
