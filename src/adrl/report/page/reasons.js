/** What the supervisor's reasons mean; adrl.deploy.messages.Reason lists them. */
const REASONS = {
  no_scan: 'no scan has come', scan_stale: 'the last scan is too old', scan_invalid: 'the scan cannot be used', scan_sparse: 'too few beams tell anything',
  scan_frozen: 'the scan does not change', scan_late: 'scans come late, which is reckoned with', scan_empty: 'nothing is within reach',
  mount: 'the LiDAR seems to be mounted otherwise', no_odometry: 'no odometry has come', odometry_stale: 'the odometry is too old',
  odometry_invalid: 'the odometry cannot be used', odometry_frozen: 'the odometry does not change', odometry_jumped: 'the odometry has jumped',
  odometry_late: 'the odometry comes late, which is reckoned with', odometry_contradicts: 'speeds and poses of the odometry do not agree',
  not_localised: 'the place on the map is not known', clock_jumped: 'the clock has jumped', clock_stopped: 'the clock stands',
  command_invalid: 'the policy gave no number', command_late: 'the command took too long', base_late: 'the base acts late, which is reckoned with',
  base_weak: 'the base accelerates less than it should', limited: 'slowed to what the base can do', unseen: 'it does not see where it would drive',
  obstacle: 'slowed or held for an obstacle', recovering: 'it frees itself',
};
const inWords = (reasons) => reasons.map((reason) => `${reason}: ${REASONS[reason] ?? ''}`).join(' · ');
