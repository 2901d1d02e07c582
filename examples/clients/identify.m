% Post a campaign file to a running service, and print the stiffness of each joint: MATLAB, or GNU Octave 7.
%   identify('http://127.0.0.1:8000', 'campaign.json')
% curl, which comes with Windows 10, macOS and most Linuxes, carries the request. If the service demands a key,
% add -H "Authorization: Bearer KEY" to its arguments.
function identify(address, file)
  [status, answer] = system(['curl -s "' address '/v1/campaigns?wait=60" ' ...
                             '-H "Content-Type: application/json" --data-binary "@' file '"']);
  if status ~= 0
    error('no answer from %s', address);
  end
  run = jsondecode(answer);
  if ~isfield(run, 'result')
    error('%s: remedy: %s', run.detail, run.remedy);  % what is wrong, where, and how to mend it
  end
  joints = run.result.joints;
  for i = 1:numel(joints)
    if iscell(joints)  % if they differ in their fields
      joint = joints{i};
    else
      joint = joints(i);
    end
    fprintf('%s: %s N.m/rad, %s\n', joint.name, num2str(joint.stiffness, 6), joint.verdict);
  end
end
