#ifndef ORI_VERSION_H
#define ORI_VERSION_H

/* Major, minor and patch in the three upper bytes. The host refuses another major, and a minor below its own
 * (FIRMWARE in ori_deploy/actuators/mcu/startup.py): a new fault or answer is a new minor. */
#define ORI_FIRMWARE_VERSION UINT32_C(0x01010000)

#endif
